"""Write the notebooks of the examples from their scripts: ``python docs/write_notebooks.py``."""

from generate import examples

if __name__ == "__main__":
    folder = examples.EXAMPLES / "notebooks"
    folder.mkdir(exist_ok=True)
    for script in examples.scripts():
        (folder / f"{script.stem}.ipynb").write_text(examples.notebook_text(script), encoding="utf-8")
