"""What ``firnline score`` was asked for, and the checks that come before any work."""

from dataclasses import dataclass
from pathlib import Path

SLOPE = "slope"
"""Value of ``--by`` for classes of slope; anything else is a file."""


@dataclass(frozen=True)
class ScoreRequest:
    """Options of the command.

    Parameters
    ----------
    source : pathlib.Path
        The map.
    truth, checkpoints, control, area, route : pathlib.Path or None
        Files that it is judged by, or that limit the judgement.
    crs : str or None
        CRS of rasters that carry none.
    standards : tuple of str
        Names of accuracy standards.
    class_m, interval_m, sigma_m : float or None
        Class and contour interval asked for, and deviation of checkpoints that state none [m].
    datum : str or None
        Vertical datum of checkpoints that state none.
    columns : tuple of str
        Mapping of columns, as it was typed.
    by : tuple of str
        Classifications: ``slope``, or files of land cover.
    class_column : str or None
        Column of polygons that names the class.
    report : pathlib.Path or None
        Folder or file of the report.
    language : str
        Language of its statements.
    force : bool
        Whether a report that is there is replaced.
    as_json : bool
        Whether numbers are printed as JSON.
    """

    source: Path
    truth: Path | None = None
    checkpoints: Path | None = None
    control: Path | None = None
    area: Path | None = None
    route: Path | None = None
    crs: str | None = None
    standards: tuple[str, ...] = ()
    class_m: float | None = None
    interval_m: float | None = None
    sigma_m: float | None = None
    datum: str | None = None
    columns: tuple[str, ...] = ()
    by: tuple[str, ...] = ()
    class_column: str | None = None
    report: Path | None = None
    language: str = "en"
    force: bool = False
    as_json: bool = False

    def check(self) -> None:
        """Refuse what cannot be done, before anything is read.

        Raises
        ------
        InputError
            Neither reference nor checkpoints, or a report that is there already.
        ConfigError
            An unknown standard, language or form of report, or a column mapping that was not understood.
        """
        from survey.core.errors import InputError
        from survey.io.text_tables.spellings import parsed_columns
        from survey.scoring.standards.standards import standard_named

        if self.truth is None and self.checkpoints is None:
            raise InputError(
                f"{self.source} cannot be judged alone; name the reference raster with --truth or points with --checkpoints."
            )
        parsed_columns(self.columns)
        for name in self.standards:
            standard_named(name)
        if self.report is not None:
            self._check_report(self.report)

    def _check_report(self, report: Path) -> None:
        from sim.cli.outputs import refuse_existing
        from survey.reporting.document.writing import OUTPUTS, check_target
        from survey.reporting.statements import template

        template(self.language)
        target = check_target(report)
        inputs = (self.source, self.truth, self.checkpoints, self.control, self.area, self.route)
        refuse_existing([target], force=self.force, inputs=inputs, own=() if target.suffix else OUTPUTS)


def refuse_options_of_maps(mission: Path, *, report: Path | None, by: list[str] | None) -> None:
    """Refuse options that a mission file does not take.

    Raises
    ------
    InputError
        ``--report`` or ``--by`` was given.
    """
    from survey.core.errors import InputError

    if report is not None or by:
        raise InputError(
            f"{mission} is a mission, whose page firnline report writes; --report and --by judge a map, name its raster or the "
            "folder 4-reconstruct of the run."
        )
