"""What the documentation shows is what happens: its code is run, its example pages exist."""

import doctest
import importlib.util
import pkgutil
import re
from pathlib import Path

import pytest

import narx_sklearn

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
if not (DOCS / "conf.py").is_file():
    pytest.skip("the documentation is not part of this distribution", allow_module_level=True)

PAGES = sorted(path for path in DOCS.rglob("*.rst") if not {"generated", "_build"} & set(path.parts))


DIAGNOSES = DOCS / "guide" / "diagnose.rst"  # three of them: what they find default tests find too


@pytest.mark.parametrize(
    "page",
    [pytest.param(page, marks=pytest.mark.long) if page == DIAGNOSES else page for page in PAGES],
    ids=lambda path: path.stem,
)
def test_the_code_on_the_page_does_what_the_page_says(page):
    found = doctest.testfile(str(page), module_relative=False, optionflags=doctest.REPORT_ONLY_FIRST_FAILURE)
    assert not found.failed


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.stem)
def test_every_script_the_page_refers_to_is_there(page):
    for name in re.findall(r"generated/examples/(\w+)", page.read_text(encoding="utf-8")):
        assert name == "index" or (ROOT / "examples" / f"{name}.py").is_file(), name


def test_the_api_pages_name_every_public_name():
    spec = importlib.util.spec_from_file_location("public_names", DOCS / "_ext" / "public_names.py")
    pages = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(pages)
    rooms = {room: pages.page(room) for room in pages.room_names() if pages.exported(room)}
    public = [
        (room, name)
        for info in pkgutil.walk_packages(narx_sklearn.__path__, "narx_sklearn.")
        if info.ispkg and "._" not in info.name and (room := info.name.partition(".")[2]) != "cli"
        for name in getattr(importlib.import_module(info.name), "__all__", ())
    ]
    public += [("", name) for name in narx_sklearn.__all__ if name != "__version__"]
    assert len(public) > 200
    forgotten = [pair for pair in public if not re.search(rf"\b{pair[1]}\n", rooms.get(pair[0], ""))]
    assert not forgotten
