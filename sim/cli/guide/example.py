"""``firnline example``: list the missions that come with firnline, or copy one of them."""

from pathlib import Path
from typing import Annotated

import typer

from sim.cli.outcome import with_exit_codes


@with_exit_codes
def example(
    name: Annotated[
        str | None, typer.Argument(help="Example to copy, such as short_drive; all are listed without it.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="File to write.  [default: NAME.toml in this folder]")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Replace a file that is there.")] = False,
) -> None:
    """Copy an example of a mission or a study, or list them all.

    For example:

      firnline example

      firnline example short_drive
    """
    files = {file.stem: file for file in sorted(examples_folder().glob("*.toml"))}
    if name is None:
        for stem, file in files.items():
            typer.echo(f"{stem:<18} {_first_sentence(file)}")
        return
    stem = name.removesuffix(".toml").replace("-", "_")
    if stem not in files:
        from survey.core.errors import ConfigError

        raise ConfigError(f"there is no example {name!r}; take {', '.join(files)}.")
    _copy(files[stem], out or Path(f"{stem}.toml"), force=force)


def examples_folder() -> Path:
    """Return the folder of the examples: in the installed package, else beside it in a checkout."""
    import sim

    package = Path(sim.__file__).parent
    installed = package / "examples"
    return installed if installed.is_dir() else package.parent / "examples"


def _copy(file: Path, target: Path, *, force: bool) -> None:
    from sim.cli.outputs import refuse_existing
    from survey.core.files.writing import replacing

    refuse_existing([target], force=force, inputs=[file])
    with replacing(target.resolve()) as draft:
        draft.write_bytes(file.read_bytes())
    command = "montecarlo" if file.stem.startswith("montecarlo") else "run"
    typer.echo(f"{target} written; run: firnline {command} {target}")


def _first_sentence(file: Path) -> str:
    """Return the first sentence of the comment at the head of a file."""
    lines = file.read_text(encoding="utf-8").splitlines()
    comment = []
    for line in lines:
        if not line.startswith("#"):
            break
        comment.append(line.lstrip("# ").rstrip())
    text = " ".join(comment)
    for end in (". ", ": "):
        text = text.split(end, 1)[0]
    return text.rstrip(".") + "."
