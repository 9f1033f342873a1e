"""The documentation site, which `make docs` builds into build/docs.

Its source folder is the repository's root, so that links between the pages under docs/, the notebooks and the files of
the root are the same on the site as in the files.
"""

import re
import sys
from importlib.metadata import version as version_of
from pathlib import Path

from autoapi.directives import AutoapiSummary
from docutils import nodes

sys.path.insert(0, str(Path(__file__).parent))

from docstrings import as_rst, inventories, is_internal, is_shown, resolved, with_shapes

ROOT = Path(__file__).parents[1]

project = "yeastfit"
author = "yeastfit developers"
copyright = "yeastfit developers, MIT licence"
release = version_of("yeastfit")
version = re.match(r"[\d.]*\d", release)[0]

extensions = ["myst_nb", "autoapi.extension", "sphinx.ext.napoleon", "sphinx.ext.intersphinx", "sphinx_copybutton"]
root_doc = "docs/index"
include_patterns = ["docs/**", "notebooks/*.ipynb", "CHANGELOG.md", "CONTRIBUTING.md", "SECURITY.md"]
exclude_patterns = [".*", "build", "out", "dist", "data", "tests", "benchmarks", "yeastfit", "docs/_*"]

html_theme = "furo"
html_title = f"yeastfit {version}"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_additional_pages = {"index": "home.html"}
templates_path = ["_templates"]
html_copy_source = html_show_sourcelink = False
html_theme_options = {"navigation_with_keys": False}

# pages are Markdown; notebooks are shown with the outputs they were committed with
myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 4
nb_execution_mode = "off"
copybutton_exclude = ".linenos, .gp, .go, .nboutput"

# the reference: public names, from the docstrings and types of the files, which are not imported
autoapi_dirs = [str(ROOT / "yeastfit")]
autoapi_file_patterns = ["*.pyi", "*.py"]
autoapi_root = "docs/reference"
autoapi_options = ["members", "imported-members", "show-inheritance"]
autoapi_own_page_level = "function"
autoapi_python_class_content = "class"
autoapi_member_order = "groupwise"
autoapi_add_toctree_entry = False
napoleon_google_docstring = True
napoleon_custom_sections = [("Arguments", "params_style")]

# types link to where they are described; a type of another package that is not known is a warning
intersphinx_mapping = inventories(ROOT / "build" / "inventories")
nitpicky = True
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 100
suppress_warnings = ["autoapi.python_import_resolution"]  # of internal constants; a test looks for every public name


def find_public(app, environment, node, content):
    """Where a name is described that types call by the place of its definition; internal types are shown without."""
    name = node.get("reftarget", "") if node.get("refdomain") == "py" else ""
    target = resolved(name) if name else None
    if target and target != name:
        domain = environment.get_domain("py")
        return domain.resolve_xref(environment, node["refdoc"], app.builder, "obj", target, node, content)
    return nodes.inline("", re.sub(r"(\w+\.)+(?=\w)", "", name)) if name and is_internal(name) else None


def is_skipped(app, what, name, obj, skip, options):
    """Whether autoapi leaves a name out; what it shows has types that Sphinx reads."""
    for attribute in {"args", "return_annotation", "annotation"} & vars(obj).keys():
        if text := getattr(obj, attribute):
            setattr(obj, attribute, with_shapes(text))
    return not is_shown(what, name, documented=not skip)


class Names(AutoapiSummary):
    """A table of names and what they are, without signatures."""

    def get_items(self, names):
        """Name, no signature, summary and page of each."""
        return [(name, "", summary, page) for name, _, summary, page in super().get_items(names)]


def setup(app):
    """What docstrings need to be read as Sphinx reads them, and which names are shown."""
    app.connect("autoapi-skip-member", is_skipped)
    app.connect("autodoc-process-docstring", lambda app, what, name, *rest: as_rst(what, name, rest[-1]), priority=1)
    app.connect("missing-reference", find_public)
    app.add_directive("autoapisummary", Names, override=True)
