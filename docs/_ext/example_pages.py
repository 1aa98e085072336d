"""Write a page for every script in ``examples/``: what it says, prints and draws, and how it is written.

A script is run when it is newer than its page. One that fails fails the build.
"""

import ast
import os
import re
import subprocess
import sys
from pathlib import Path

from sphinx.errors import ExtensionError
from sphinx.util import logging
from sphinx.util.display import status_iterator

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
GROUPS = {  # beginning of a script's name: heading
    "quick_start": "First steps",
    "compensate": "Compensators",
    "thesis": "Examples and figures of the thesis",
    "": "How to",
}
LONGEST = 600  # seconds for one script
log = logging.getLogger(__name__)


def setup(app):
    """Register the option and the writer; called by Sphinx."""
    app.add_config_value("run_examples", True, "env", types=[bool])
    app.connect("builder-inited", write_pages)
    return {"parallel_read_safe": True}


def write_pages(app) -> None:
    """Run what has to be run, write the pages and the gallery."""
    folder = Path(app.srcdir) / "generated" / "examples"
    folder.mkdir(parents=True, exist_ok=True)
    scripts = sorted(path for path in EXAMPLES.glob("*.py") if not path.name.startswith("_"))
    for script in status_iterator(scripts, "running examples... ", length=len(scripts), stringify_func=str):
        printed = folder / f"{script.stem}.txt"
        if app.config.run_examples and is_stale(printed, script):
            printed.write_text(run(script, folder), encoding="utf-8")
        (folder / f"{script.stem}.rst").write_text(page(script, folder), encoding="utf-8")
    (folder / "index.rst").write_text(gallery(scripts, folder), encoding="utf-8")


def is_stale(printed: Path, script: Path) -> bool:
    """Tell whether a script has changed since it was last run."""
    return not printed.exists() or printed.stat().st_mtime < script.stat().st_mtime


def run(script: Path, folder: Path) -> str:
    """Run a script as a reader would and return what it prints."""
    options = ["--quick"] if "--quick" in script.read_text(encoding="utf-8") else []
    path = os.pathsep.join(filter(None, [str(EXAMPLES.parent), os.environ.get("PYTHONPATH")]))
    done = subprocess.run(
        [sys.executable, str(script), "--out", str(folder), *options],
        capture_output=True,
        text=True,
        timeout=LONGEST,
        env={**os.environ, "MPLBACKEND": "Agg", "PYTHONPATH": path},
        check=False,
    )
    if done.returncode:
        raise ExtensionError(f"{script.name} ended with exit code {done.returncode}:\n{done.stderr}")
    return done.stdout.replace(str(folder) + os.sep, "")


def sentences(script: Path) -> tuple[str, str]:
    """Return the first line of a script's docstring, and the rest."""
    text = ast.get_docstring(ast.parse(script.read_text(encoding="utf-8"))) or script.stem
    first, _, rest = text.partition("\n")
    return first.rstrip("."), rest.strip()


def title_of(script: Path) -> str:
    """Return the name of a script in words; numbers of sections keep their points."""
    return re.sub(r"(?<=\d) (?=\d)", ".", script.stem.replace("_", " ")).capitalize()


def page(script: Path, folder: Path) -> str:
    """Return the page of one script."""
    first, rest = sentences(script)
    title = title_of(script)
    parts = [title, "=" * len(title), "", f"{first}.", "", rest, ""]
    if (folder / f"{script.stem}.png").exists():
        parts += [f".. image:: {script.stem}.png", f"   :alt: Figure of {script.name}", ""]
    printed = folder / f"{script.stem}.txt"
    if printed.exists() and printed.read_text(encoding="utf-8").strip():
        parts += ["It prints:", "", f".. literalinclude:: {printed.name}", "   :language: none", ""]
    source = os.path.relpath(script, folder).replace(os.sep, "/")
    return "\n".join([*parts, "The script:", "", f".. literalinclude:: {source}", "   :language: python", ""])


def group_of(script: Path) -> str:
    """Return the heading that a script stands under."""
    return next(heading for start, heading in GROUPS.items() if script.stem.startswith(start))


def gallery(scripts: list[Path], folder: Path) -> str:
    """Return the page that lists all scripts with their pictures, group by group."""
    lines = ["Examples", "========", "", "Each runs as it stands: ``python examples/<name>.py``.", ""]
    order = [GROUPS["quick_start"], GROUPS[""], GROUPS["compensate"], GROUPS["thesis"]]
    for heading in order:
        lines += [heading, "-" * len(heading), ""]
        for script in (s for s in scripts if group_of(s) == heading):
            lines += [f":doc:`{title_of(script)} <{script.stem}>`", f"   {sentences(script)[0]}.", ""]
            if (folder / f"{script.stem}.png").exists():
                lines += [
                    f"   .. image:: {script.stem}.png",
                    "      :width: 45%",
                    f"      :alt: Figure of {script.name}",
                    "",
                ]
    lines += [".. toctree::", "   :hidden:", "", *(f"   {script.stem}" for script in scripts), ""]
    return "\n".join(lines)
