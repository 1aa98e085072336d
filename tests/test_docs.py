"""What the documentation shows is what happens: its code is run, its example pages exist."""

import doctest
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
if not (DOCS / "conf.py").is_file():
    pytest.skip("the documentation is not part of this distribution", allow_module_level=True)

PAGES = sorted(path for path in DOCS.rglob("*.rst") if not {"generated", "_build"} & set(path.parts))


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.stem)
def test_the_code_on_the_page_does_what_the_page_says(page):
    found = doctest.testfile(str(page), module_relative=False, optionflags=doctest.REPORT_ONLY_FIRST_FAILURE)
    assert not found.failed


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.stem)
def test_every_script_the_page_refers_to_is_there(page):
    for name in re.findall(r"generated/examples/(\w+)", page.read_text(encoding="utf-8")):
        assert name == "index" or (ROOT / "examples" / f"{name}.py").is_file(), name
