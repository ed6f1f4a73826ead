"""Configuration of the documentation site; `make docs` builds it."""

import sys
from importlib.metadata import version as version_of
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent / "_extensions"))

project = "fjh: fault-tolerant control"
release = version = version_of("fault-tolerant-hexapod")

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosectionlabel",
    "sphinx.ext.mathjax",
    "sphinx.ext.napoleon",
    "sphinx_gallery.gen_gallery",
    "sphinx-mathjax-offline",  # typesets equations without network
    "docstrings",
    "tables",
    "theory_links",
    "tour",
]
exclude_patterns = ["_extensions"]

# A broken reference is an error. Names of other packages are not looked up: the build needs no
# network.
nitpicky = True
nitpick_ignore_regex = [
    ("py:.*", r"(?!argument_checks|experiments|fjh|prioritized|ftc|sim)\w+(\..*)?"),
    ("py:.*", r"prioritized\._.*"),
    ("py:.*", r"(sim|ftc)\.\w+\.[\w.]+"),  # private modules: public names are shorter
]

# Only extensions that GitHub supports: the pages are also read there.
myst_enable_extensions = ["dollarmath"]
myst_fence_as_directive = ["math"]
myst_heading_anchors = 3

# The examples are run, and shown with their output and as notebooks.
sphinx_gallery_conf = {
    "examples_dirs": "../examples",
    "gallery_dirs": "gallery",
    "filename_pattern": "/",
    "within_subsection_order": "FileNameSortKey",
    "download_all_examples": False,
    "write_computation_times": False,
    "min_reported_time": 3600,
    "abort_on_example_error": True,
}

autosectionlabel_prefix_document = True
autosectionlabel_maxdepth = 2

default_role = "code"  # docstrings put names in single backticks
napoleon_numpy_docstring = False
napoleon_attr_annotations = False  # shapes and units stand in the text
autoclass_content = "both"
autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
toc_object_entries_show_parents = "hide"
python_maximum_signature_line_length = 80


html_theme = "furo"
html_title = project
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_copyright = False
html_show_sphinx = False
html_copy_source = False
