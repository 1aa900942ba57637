"""Sphinx's settings for the site; `make docs` builds it."""

import importlib.metadata

project = "drake_srg"
author = "the authors of drake_srg"
release = importlib.metadata.version("drake_srg")

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "make_site.extension",
]
html_theme = "furo"
html_title = "drake_srg"
html_static_path = ["_static"]
html_logo = html_favicon = "_static/mark.svg"
html_extra_path = ["../extra"]  # replays
exclude_patterns = ["conf.py"]
html_css_files = ["site.css"]
html_show_sphinx = False
html_copy_source = False
# Browsers let no page from a disk fetch another one, as summaries of results need.
html_show_search_summary = False
html_theme_options = {"navigation_with_keys": True}

# Headings have the anchors that Git hosts give them.
myst_heading_anchors = 4
# Backquotes in docstrings: a link where Sphinx knows the name, else code.
default_role = "py:obj"
smartquotes = False
# Blocks without a language are diagrams and formulas.
highlight_language = "none"

autodoc_default_options = {
    "undoc-members": True,
    "show-inheritance": True,
    "no-value": True,
    "member-order": "bysource",
}
# The extra `learn`, which takes gigabytes, is not needed to document what uses it.
autodoc_mock_imports = ["stable_baselines3", "torch"]
autodoc_typehints = "signature"
autodoc_preserve_defaults = True
napoleon_use_rtype = False
napoleon_use_ivar = True  # the fields of a dataclass are described by themselves
python_display_short_literal_types = True
python_maximum_signature_line_length = 88
# Thousands of names in every page's navigation would take most of the time.
toc_object_entries = False
