"""How the pages become a site: ``make docs`` builds it into build/docs, without a network, and warnings are errors."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

import coheft

project = "coheft"
release = coheft.__version__
html_title = "coheft"

extensions = ["myst_parser", "mathml", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_class_signature = "separated"
autodoc_preserve_defaults = True
autodoc_type_aliases = {"npt.ArrayLike": "ArrayLike"}
autodoc_default_options = {"exclude-members": "__init__, __new__"}
napoleon_attr_annotations = False
napoleon_use_ivar = True
napoleon_use_rtype = False
exclude_patterns: list[str] = []

myst_enable_extensions = ["dollarmath", "deflist"]
myst_heading_anchors = 3  # links such as method.md#poses
html_math_renderer = "mathml"
myst_dmath_double_inline = False

html_theme = "furo"
html_static_path = ["static"]
html_css_files = ["coheft.css"]
html_copy_source = False
html_show_copyright = False
html_theme_options = {
    "light_css_variables": {"color-brand-primary": "#0b62a4", "color-brand-content": "#0b62a4"},
    "dark_css_variables": {"color-brand-primary": "#7db8e8", "color-brand-content": "#7db8e8"},
}
highlight_language = "none"
pygments_style = "friendly"
