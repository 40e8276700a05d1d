"""Tutorials: the scripts of ``examples/`` as notebooks that the build executes."""

from pathlib import Path

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
LONG_TUTORIALS = ("drive_by_commands", "drive_to_map", "how_many_swaths", "simulate_first")
"""Tutorials of half a minute and more."""


def notebooks() -> dict[str, str]:
    """Return every script of the examples as a notebook without outputs."""
    return {f"tutorials/{script.stem}.ipynb": notebook_text(script) for script in scripts()}


def scripts() -> list[Path]:
    """Return the scripts, in the order of their names."""
    return sorted(EXAMPLES.glob("*.py"))


def notebook_text(script: Path) -> str:
    """Return a script in cells (``# %%``) as the text of a Jupyter notebook; the same script gives the same text."""
    import jupytext
    from nbformat.v4 import new_code_cell

    notebook = jupytext.read(script, fmt="py:percent")
    notebook.cells.insert(0, new_code_cell("%matplotlib inline", metadata={"tags": ["remove-cell"]}))
    for number, cell in enumerate(notebook.cells):
        cell["id"] = f"cell-{number}"
    notebook.metadata = {"kernelspec": {"name": "python3", "display_name": "Python 3", "language": "python"}}
    return str(jupytext.writes(notebook, fmt="ipynb")) + "\n"
