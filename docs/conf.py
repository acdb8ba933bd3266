"""How the site is built: `sphinx-build -W -n --keep-going -b html docs build/site`.

The pages are the plain Markdown of this folder. What is made from the code when the site is built (the reference, the
tables) and what is shown from elsewhere in the repository (notebooks, the changelog) is made by `_ext/`, into folders
that git ignores.
"""

import os
import sys
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE / "_ext"))
sys.path.insert(0, str(HERE.parent))
os.environ.setdefault("JAX_PLATFORMS", "cpu")
os.environ.setdefault("JAX_ENABLE_X64", "1")

import jaxtyping  # noqa: F401  (imported first, so that signatures have the shapes)

import jaxnc

project = "jaxnc"
author = "The jaxnc authors"
project_copyright = "the jaxnc authors, Apache License 2.0"
release = version = jaxnc.__version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx_design",
    "from_repository",
    "reference",
    "live",
    "mathml",
    "gallery",
]
exclude_patterns = ["_ext", "paper.md", "**/.ipynb_checkpoints"]
suppress_warnings = ["config.cache"]
default_role = "named"  # a name in docstrings, `sweep`: a link where it is public, code where not

# Markdown
myst_enable_extensions = ["attrs_block", "attrs_inline", "colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
nb_execution_mode = "off"  # notebooks are stored with their outputs, and run by tests/docs/test_notebooks.py

# Docstrings
autosummary_generate = False
autoclass_content = "both"
autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
autodoc_class_signature = "mixed"
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
napoleon_use_rtype = False
add_module_names = False
python_maximum_signature_line_length = 100
toc_object_entries_show_parents = "hide"

# Every name that is ours has to lead somewhere; those of others are not looked up, as there may be no network.
nitpicky = True

# Looks
html_math_renderer = "mathml"
html_theme = "furo"
html_title = "jaxnc"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_copy_source = False
html_show_sourcelink = False
html_show_sphinx = False
pygments_style = "friendly"
pygments_dark_style = "github-dark"
html_theme_options = {
    "light_css_variables": {"color-brand-primary": "#1f5f9f", "color-brand-content": "#1f5f9f"},
    "dark_css_variables": {"color-brand-primary": "#7db7f0", "color-brand-content": "#7db7f0"},
}
