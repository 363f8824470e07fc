"""How the documentation is built: `make docs`, without the network."""

from __future__ import annotations

import importlib
import os
import pkgutil
from pathlib import Path
from types import ModuleType
from typing import Any

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from jinja2 import FileSystemLoader
from jinja2.sandbox import SandboxedEnvironment
from numpydoc import docscrape_sphinx
from sphinx.errors import ExtensionError

os.environ["COLUMNS"] = "100"

import ballscrew

project = "ballscrew"
author = "The ballscrew authors"
copyright = "the ballscrew authors, BSD-3-Clause"
version = release = ballscrew.__version__

extensions = ["myst_parser", "numpydoc", "sphinx.ext.autodoc"]
exclude_patterns = ["_build"]
source_suffix = {".md": "markdown"}
nitpicky = False
language = "en"

myst_enable_extensions = ["colon_fence", "deflist", "dollarmath"]
myst_heading_anchors = 3

autodoc_member_order = "bysource"
autodoc_typehints = "none"  # numpydoc's sections say them, with their units
autodoc_default_options = {"members": True}
autosummary_generate = False  # numpydoc brings it along
numpydoc_show_class_members = False
numpydoc_xref_param_type = False
# numpydoc compiles its template for every object, which takes a third of the build.
_TEMPLATES = SandboxedEnvironment(
    loader=FileSystemLoader(Path(docscrape_sphinx.__file__).parent / "templates")
)
docscrape_sphinx.SandboxedEnvironment = lambda **_: _TEMPLATES
toc_object_entries = False  # every function in the sidebar took a third of the build

html_theme = "furo"
html_title = f"ballscrew {release}"
html_static_path = ["_static/ballscrew.css"]  # pictures are copied by the pages that show them
html_css_files = ["ballscrew.css"]
html_copy_source = False
html_search_scorer = str(Path(__file__).with_name("scorer.js"))  # guides before the API
html_theme_options = {"navigation_with_keys": True}

LARGEST_SIZE = 20e6
"""Limit of the built pages, bytes; with the source of every module they had 30 MB."""

SUBPACKAGES = {
    "base": "base: units, errors, files",
    "axis": "axis: what is the machine?",
    "fcft": "fcft: what is the test?",
    "testbed": "testbed: what would a known machine have measured?",
    "recording": "recording: what was measured?",
    "modal": "modal: what is the axial natural frequency?",
    "calibration": "calibration: which model is this axis?",
    "estimation": "estimation: how much preload is left?",
    "monitoring": "monitoring: has it changed, since when?",
    "prognosis": "prognosis: how long will it last?",
    "report": "report: what does it look like?",
    "reproduction": "reproduction: does the paper hold?",
    "sending": "sending: how does a run reach the server?",
    "store": "store: what was measured, estimated and decided?",
    "service": "service: who sends runs, and who needs to know?",
    "cli": "cli: the command line",
}


def _modules(subpackage: str) -> list[str]:
    """Names of the modules of a subpackage that define something public."""
    package = importlib.import_module(f"ballscrew.{subpackage}")
    found = [m.name for m in pkgutil.walk_packages(package.__path__, f"{package.__name__}.")]
    return [name for name in found if _defines_something(importlib.import_module(name))]


def _defines_something(module: ModuleType) -> bool:
    public = [item for name, item in vars(module).items() if not name.startswith("_")]
    return any(getattr(item, "__module__", None) == module.__name__ for item in public)


def _write_api(_: Any) -> None:
    """Write one page per subpackage from its modules, so that none is missing."""
    folder = Path(__file__).parent / "reference" / "api"
    folder.mkdir(exist_ok=True)
    for subpackage, title in SUBPACKAGES.items():
        head = [f".. automodule:: ballscrew.{subpackage}", "   :no-members:"]
        lines = [f"# {title}", "", "```{eval-rst}", *head, "```"]
        for name in _modules(subpackage):
            short = name.removeprefix("ballscrew.")
            lines += ["", f"## `{short}`", "", "```{eval-rst}", f".. automodule:: {name}", "```"]
        text = "\n".join(lines) + "\n"
        page = folder / f"{subpackage}.md"
        if not page.is_file() or page.read_text(encoding="utf-8") != text:
            page.write_text(text, encoding="utf-8")


def _visit_inline(translator: Any, node: nodes.math) -> None:
    translator.body.append(tex2mathml(node.astext()))
    raise nodes.SkipNode


def _visit_block(translator: Any, node: nodes.math_block) -> None:
    translator.body.append(f'<div class="math">{tex2mathml(node.astext(), as_block=True)}</div>')
    raise nodes.SkipNode


def _check_size(app: Any, error: Exception | None) -> None:
    size = sum(path.stat().st_size for path in Path(app.outdir).rglob("*") if path.is_file())
    if error is None and size > LARGEST_SIZE:
        raise ExtensionError(f"the pages have {size / 1e6:.0f} MB; the limit is {LARGEST_SIZE / 1e6:.0f} MB")


def setup(app: Any) -> None:
    """Write the pages of the subpackages; formulas become MathML, which browsers draw without a script."""
    app.connect("builder-inited", _write_api)
    app.connect("build-finished", _check_size)
    app.add_html_math_renderer(
        "mathml", inline_renderers=(_visit_inline, None), block_renderers=(_visit_block, None)
    )


html_math_renderer = "mathml"
