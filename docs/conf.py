"""The site: ``make docs`` builds it, with warnings as errors."""

import gc
import importlib.metadata
import shutil
import sys
import warnings
from pathlib import Path

gc.set_threshold(100_000, 50, 50)  # pages are large trees: to search them more often takes an eighth of the build

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent / "scripts")]

import gallery  # noqa: E402
import reference_pages  # noqa: E402
from source_pages import linkcode_resolve as linkcode_resolve  # noqa: E402

import build_pool  # noqa: E402

shutil.rmtree(HERE / "reference" / "api", ignore_errors=True)  # pages of names that are gone
reference_pages.write(HERE / "reference")
gallery.copy_sources(HERE)
build_pool.write(HERE / "_build" / "pool")

project = "uvms-mj"
author = "The uvms-mj authors"
project_copyright = author
version = release = importlib.metadata.version(project)

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.linkcode",
    "sphinx.ext.napoleon",
    "sphinx-mathjax-offline",
    "sphinx_copybutton",
    "sphinx_design",
    "sphinx_gallery.gen_gallery",
    "source_pages",
    "api_pages",
    "line_breaks",
    "units",
]
exclude_patterns = [
    "_build",
    "pool",
    "results",
    "gallery/**.ipynb",
    "gallery/**.py",
    "sg_execution_times.rst",
    "**/.ipynb_checkpoints",
]

# Pages
myst_enable_extensions = ["colon_fence", "dollarmath", "html_image"]
myst_dmath_double_inline = True
myst_heading_anchors = 4
myst_url_schemes = {"http": None, "https": None, "mailto": None, "source": None}  # source: see source_pages.py
nb_execution_mode = "cache"
nb_execution_in_temp = True
nb_execution_timeout = 300
nb_execution_raise_on_error = True
nb_merge_streams = True
copybutton_exclude = ".linenos, .gp, .go"
suppress_warnings = ["misc.highlighting_failure"]  # a block of output in the words of a program has no language

# Gallery. A warning is printed without the folder of the build, and without the line that it shows below itself
warnings.formatwarning = lambda message, category, *_: f"{category.__name__}: {message}\n"
warnings.filterwarnings("ignore", message=".*DISPLAY environment variable is missing")  # dm_control asks GLFW first
sphinx_gallery_conf = {
    "examples_dirs": [str(HERE / "_build" / "gallery")],
    "gallery_dirs": ["gallery"],
    "filename_pattern": gallery.RUN,
    "image_scrapers": ("gallery.figures",),
    "abort_on_example_error": True,
    "download_all_examples": False,
    "show_memory": False,
    "capture_repr": ("_repr_html_",),
    "write_computation_times": False,
    "default_thumb_file": str(HERE / "push_wall.png"),
    "min_reported_time": 1e9,
    "within_subsection_order": "gallery.Order",
    "nested_sections": True,
    "remove_config_comments": True,
}

# API
templates_path = ["_templates"]
autosummary_generate = True
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
html_domain_indices = False
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented_params"
autodoc_default_options = {"members": True}
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_attr_annotations = False
toc_object_entries_show_parents = "hide"

# Looks. Nothing is loaded from another address.
html_theme = "pydata_sphinx_theme"
html_title = "uvms-mj"
html_static_path = ["_static", "_build/pool"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_context = {"default_mode": "auto"}
html_theme_options = {
    "header_links_before_dropdown": 7,
    "navbar_align": "left",
    "navbar_end": ["theme-switcher"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "show_prev_next": True,
    "show_toc_level": 2,
    "secondary_sidebar_items": ["page-toc"],
    "pygments_light_style": "friendly",
    "pygments_dark_style": "github-dark",
}
html_sidebars = {"index": []}
