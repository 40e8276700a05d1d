"""HTML page of a survey: map, errors, uncertainty, settings and provenance."""

from collections.abc import Mapping
from pathlib import Path

from survey.core.errors import InputError
from survey.core.files.writing import replacing
from survey.reporting import summary_text as words
from survey.reporting.fleet_rows import fleet_rows
from survey.reporting.payload_rows import payload_rows
from survey.reporting.picture import Picture
from survey.reporting.pictures import pictures_of
from survey.reporting.quantities import named_values, setting
from survey.reporting.rendering import rendered
from survey.reporting.score_rows import score_rows
from survey.reporting.surveyed import SurveyResults
from survey.scoring.score import Score
from survey.scoring.standards.certificate import own_claim


def write_report(
    folder: str | Path,
    survey: SurveyResults,
    *,
    title: str,
    localization: Mapping[str, float | None] | None = None,
    config_text: str = "",
    provenance: Mapping[str, str] | None = None,
) -> Path:
    """Write ``index.html`` and ``figures/*.png`` into a folder.

    The page loads nothing: figures are inside it as WebP, and there are no scripts. Links download tables from the
    page itself, and figures from the folder beside it. Equal input gives equal bytes; the page states no date.

    Parameters
    ----------
    folder : str or pathlib.Path
        Made when it does not exist; its parent must.
    survey : SurveyResults
        Results to show.
    title : str
        Heading of the page.
    localization : mapping of str to float or None, optional
        Results of the localization, units in the names.
    config_text : str
        The resolved configuration, shown as it is.
    provenance : mapping of str to str, optional
        Versions, seed, checksums, in the order to show them.

    Returns
    -------
    pathlib.Path
        Of ``index.html``.

    Raises
    ------
    InputError
        When the folder cannot be written to, or the inputs are in different CRS.
    """
    place = Path(folder)
    if not place.parent.is_dir():
        raise InputError(f"the report folder {place} has no parent folder; create {place.parent} first.")
    pictures = pictures_of(survey)
    page = rendered(
        "report.html.j2",
        title=title,
        pictures=pictures,
        localization=named_values(localization or {}),
        fleet=fleet_rows(survey.fleet, survey.route),
        hazard=named_values({} if survey.hazard is None else survey.hazard.facts),
        payload=payload_rows(survey.payload),
        losses=named_values({} if survey.fleet is None else survey.fleet.losses),
        config_text=config_text,
        provenance=dict(provenance or {}),
        **_said(survey),
    )
    return _write(place, page, pictures)


def _said(survey: SurveyResults) -> dict[str, object]:
    """Return the content about map and score, by the names of the template."""
    score, route, reconstruction = survey.score, survey.route, survey.reconstruction
    datum = reconstruction.mean.vertical_datum or "an unstated datum"
    return {
        "is_met": score.verdicts[0].met,
        "verdict_label": words.verdict_label(score.verdicts[0]),
        "verdict_sentence": words.verdict_sentence(score.verdicts),
        "conditions": words.conditions(score),
        "classes": words.classes_by_standard(score),
        "classes_as_rows": _class_rows(score),
        "key_numbers": words.key_numbers(score, route),
        "calibration_sentence": words.calibration_sentence(score.calibration),
        "own_claim": [sentence[0].upper() + sentence[1:] for sentence in own_claim(reconstruction)],
        "scores": score_rows(score),
        "prediction": named_values(route.prediction),
        "method": reconstruction.method,
        "hyperparameters": {name: setting(v) for name, v in reconstruction.hyperparameters.items()},
        "crs": f"{reconstruction.mean.crs.name}, heights above {datum}",
    }


def _class_rows(score: Score) -> dict[str, list[list[str]]]:
    """Return the rows of each table of classes as text, for its download."""
    return {
        standard: [
            ["class", "contour interval", "limit of the RMSE", "verdict"],
            *([v.map_class, interval, limit, "met" if v.met else "not met"] for v, interval, limit in rows),
        ]
        for standard, rows in words.classes_by_standard(score).items()
    }


def _write(folder: Path, page: str, pictures: Mapping[str, Picture]) -> Path:
    """Write the pictures, then the page."""
    try:
        folder.mkdir(exist_ok=True)
        (folder / "figures").mkdir(exist_ok=True)
    except OSError as error:
        raise InputError(
            f"the report folder {folder} could not be made ({error.strerror or error}); choose another place."
        ) from error
    for name, picture in pictures.items():
        with replacing(folder / "figures" / f"{name}.{picture.kind}") as draft:
            draft.write_bytes(picture.image)
    with replacing(folder / "index.html") as draft:
        draft.write_bytes(page.encode("utf-8"))
    return folder / "index.html"
