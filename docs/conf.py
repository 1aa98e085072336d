"""Settings of the documentation: `python -m sphinx -W --keep-going docs docs/_build/html`.

Two sorts of pages are written at each build (see `_ext`): one for every public name, and one for every
script in `examples/`, with what it prints and the figure it draws. `-D run_examples=0` leaves the scripts
unrun, for a quick look at the text.
"""

import sys
from pathlib import Path

DOCS = Path(__file__).resolve().parent
sys.path[:0] = [str(DOCS.parent), str(DOCS / "_ext")]

import numpy as np  # noqa: E402

import narx_sklearn  # noqa: E402

project = "narx_sklearn"
author = "The narx_sklearn developers"
release = version = narx_sklearn.__version__

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.mathjax",
    "sphinx.ext.viewcode",
    "numpydoc",
    "public_names",
    "example_pages",
]
templates_path = ["_templates"]
exclude_patterns = ["_build"]
default_role = "py:obj"

autosummary_generate = True
numpydoc_show_class_members = False
autodoc_typehints = "none"  # types stand in the docstrings
autodoc_class_signature = "mixed"

html_theme = "pydata_sphinx_theme"
html_title = "narx_sklearn"
html_static_path = ["_static"]
html_theme_options = {
    "show_prev_next": False,
    "navigation_with_keys": False,
    "secondary_sidebar_items": ["page-toc"],
}
html_sidebars = {page: [] for page in ("index", "getting_started", "coming_from")}  # nothing lies below them
html_show_sourcelink = False


def setup(app):
    """Leave out what has no documentation of its own."""
    app.connect("autodoc-skip-member", skip_member)


def skip_member(app, what, name, value, skip, options):
    """Skip scikit-learn's generated ``set_*_request`` methods, and callables stored as a field's default."""
    is_request = name.startswith("set_") and name.endswith("_request")
    return True if is_request or isinstance(value, np.ufunc) else None


html_context = {"default_mode": "auto"}  # without it the theme complains in the browser's console
html_css_files = ["site.css"]
