"""Sphinx configuration: written pages, reference pages from the code, notebooks and gallery from ``examples/``."""

import os
import sys
from importlib.metadata import version as version_of
from pathlib import Path

DOCS = Path(__file__).resolve().parent
sys.path[:0] = [str(DOCS.parent), str(DOCS)]
os.environ["PYTHONPATH"] = str(DOCS.parent)  # for the processes of the notebooks
os.environ.pop("MPLBACKEND", None)  # notebooks draw inline

from generate import examples, gallery, pages  # noqa: E402
from jupyter_client.manager import KernelManager  # noqa: E402

KernelManager.transport_encryption.default_value = "required"  # kernels warn of unencrypted sockets

pages.write_all(DOCS)

project = "firnline"
author = "The firnline developers"
copyright = "The firnline developers"  # noqa: A001
version = release = version_of("firnline")

extensions = [
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "numpydoc",
    "myst_nb",
    "sphinx_gallery.gen_gallery",
    "sphinx_design",
    "sphinx_copybutton",
    "sphinxcontrib.bibtex",
    "generate.mathml",
]
templates_path = ["_templates"]
exclude_patterns = ["_build", "**/*.ipynb_checkpoints", "gallery/**/*.[!r]*", "gallery/*.[!r]*", "generate"]
default_role = "literal"
suppress_warnings = ["config.cache"]

# Formulas become MathML, which browsers draw without a script.
html_math_renderer = "mathml"
myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3
nb_execution_mode = "force"
# What takes longest is shown as it stands where `make docs NOTEBOOKS=short` asks for it.
is_short = os.environ.get("NOTEBOOKS") == "short"
LONG_FIGURES = ("lidar_survey", "scenes", "surfaces")
nb_execution_excludepatterns = (
    [f"tutorials/{name}.ipynb" for name in examples.LONG_TUTORIALS] if is_short else []
)
nb_execution_in_temp = True
nb_execution_raise_on_error = True
nb_execution_timeout = 900
nb_merge_streams = True
nb_ipywidgets_js: dict[str, dict[str, str]] = {}

autodoc_typehints = "none"
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
autosummary_generate = True
numpydoc_show_class_members = False
numpydoc_xref_param_type = False

bibtex_bibfiles = ["references.bib"]
bibtex_default_style = "plain"
bibtex_reference_style = "author_year"

sphinx_gallery_conf = {
    "examples_dirs": "../examples/gallery",
    "gallery_dirs": "gallery",
    "subsection_order": gallery.SECTIONS,
    "filename_pattern": rf"plot_(?!{'|'.join(LONG_FIGURES)})" if is_short else r"\.py$",
    "image_scrapers": (gallery.FigureScraper(),),
    "reset_modules": (),
    "capture_repr": (),
    "abort_on_example_error": True,
    "download_all_examples": False,
    "show_memory": False,
    "show_signature": False,
    "min_reported_time": 10_000,
    "write_computation_times": False,
    "remove_config_comments": True,
}

html_theme = "pydata_sphinx_theme"
html_title = "firnline"
html_static_path = ["_static"]
html_css_files = ["firnline.css"]
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "show_prev_next": False,
    "show_toc_level": 2,
    "navigation_with_keys": False,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "pygments_light_style": "friendly",
    "pygments_dark_style": "monokai",
}
html_context = {"default_mode": "light"}
copybutton_prompt_text = r"\$ |>>> |\.\.\. "
copybutton_prompt_is_regexp = True
