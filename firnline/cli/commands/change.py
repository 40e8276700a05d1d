"""Commands of two surveys: ``change`` and ``track``."""

from firnline.actions import changes
from firnline.cli.outcome import with_exit_codes
from firnline.cli.request import DryRun, Json, Quiet, print_result, with_options_of


@with_exit_codes
@with_options_of(changes.ChangeRequest)
def change(request: changes.ChangeRequest, dry_run: DryRun = False, as_json: Json = False) -> None:
    """Compute the change of elevation, volume and mass on the ground, with correlated errors.

    For example:

      firnline change 2026.tif 2024.tif --outline glacier.gpkg

      firnline change 2026.tif srtm.tif --outline glacier.shp --align --density 900 --density-std 20

      firnline change 2026.tif 2024.tif --outline glacier.gpkg --report change.pdf

      firnline change 2026.tif 2024.tif --outline glacier.gpkg --flow track --thickness 80
    """
    if dry_run:
        print_result(changes.preview_change(request))
    else:
        print_result(changes.change(request).write(), as_json=as_json)


@with_exit_codes
@with_options_of(changes.TrackRequest)
def track(request: changes.TrackRequest, dry_run: DryRun = False, quiet: Quiet = False) -> None:
    """Track the features of a moving surface between two surveys: displacements, velocities and their errors.

    Weak matches, and those that contradict their neighbours, are written with outlier = 1.

    For example:

      firnline track 2024.tif 2026.tif --days 730 -o velocity.gpkg
    """
    if dry_run:
        print_result(changes.preview_track(request))
    else:
        print_result(changes.track(request).write(), quiet=quiet)
