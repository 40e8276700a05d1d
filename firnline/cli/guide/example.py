"""``firnline example``: list the missions, studies and tutorials that come with firnline, or copy one of them."""

import tomllib
from pathlib import Path
from typing import Annotated

import typer

from firnline.cli.facts import end_dry_run
from firnline.cli.options import DryRun
from firnline.cli.outcome import with_exit_codes

_HEADINGS = {".toml": "missions and studies", ".py": "tutorials, as script NAME or notebook NAME.ipynb"}


@with_exit_codes
def example(
    name: Annotated[
        str | None, typer.Argument(help="Example to copy, such as short_drive; all are listed without it.")
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="File to write.  [default: in this folder, named as the example]"),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing file.")] = False,
    dry_run: DryRun = False,
) -> None:
    """Copy an example, or list them all: missions, studies, tutorials as scripts and notebooks.

    For example:

      firnline example

      firnline example short_drive

      firnline example dem_to_route.ipynb
    """
    if name is None:
        _list()
    else:
        source = _source(name)
        _copy(source, out or Path(source.name), force=force, dry_run=dry_run)


def _list() -> None:
    """Print the names of all examples with one sentence each."""
    for suffix, heading in _HEADINGS.items():
        typer.echo(f"{heading}:")
        for file in sorted(examples_folder().glob(f"*{suffix}")):
            typer.echo(f"  {file.stem:<18} {_first_sentence(file)}")


def _source(name: str) -> Path:
    """Return the file of an example by its name, with or without its suffix."""
    folder = examples_folder()
    files = [*sorted(folder.glob("*.toml")), *sorted(folder.glob("*.py")), *folder.glob("notebooks/*.ipynb")]
    wanted = name.replace("-", "_")
    for file in files:
        if wanted in (file.name, file.stem):
            return file
    from survey.core.errors import ConfigError

    names = dict.fromkeys(file.stem for file in files)
    raise ConfigError(f"there is no example {name!r}; take {', '.join(names)}.")


def examples_folder() -> Path:
    """Return the folder of the examples: in the installed package, else beside it in a checkout."""
    import sim

    package = Path(sim.__file__).parent
    installed = package / "examples"
    return installed if installed.is_dir() else package.parent / "examples"


def _copy(file: Path, target: Path, *, force: bool, dry_run: bool) -> None:
    from firnline.cli.outputs import refuse_existing
    from survey.core.files import replacing

    refuse_existing([target], force=force, inputs=[file])
    if dry_run:
        end_dry_run([target])
    with replacing(target.resolve()) as draft:
        draft.write_bytes(file.read_bytes())
    typer.echo(f"{target} written; run: {_command(file)} {target}")


def _command(file: Path) -> str:
    """Return the command that runs an example."""
    if file.suffix == ".toml":
        is_study = "trials" in tomllib.loads(file.read_text(encoding="utf-8"))
        return "firnline montecarlo" if is_study else "firnline run"
    return "python" if file.suffix == ".py" else "jupyter lab"


def _first_sentence(file: Path) -> str:
    """Return the first sentence of the comment at the head of a mission, or the title of a tutorial."""
    comment = []
    for line in file.read_text(encoding="utf-8").removeprefix("# %% [markdown]\n").splitlines():
        text = line.lstrip("# ").rstrip()
        if not line.startswith("#") or not text:
            break
        comment.append(text)
    sentence = " ".join(comment)
    for end in (". ", ": "):
        sentence = sentence.split(end, 1)[0]
    return sentence.rstrip(".") + "."
