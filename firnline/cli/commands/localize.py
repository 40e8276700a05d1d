"""``firnline localize``: path and landmarks from a recording."""

from firnline.actions import localizing
from firnline.cli.outcome import with_exit_codes
from firnline.cli.request import DryRun, Json, Quiet, print_result, with_options_of


@with_exit_codes
@with_options_of(localizing.LocalizeRequest)
def localize(
    request: localizing.LocalizeRequest,
    dry_run: DryRun = False,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Estimate the path of a rover and its landmarks from a recording.

    For example:

      firnline localize results/runs/mine/latest/2-simulate/recording

      firnline localize KITTI_sequence_1 --scale-from 10

      firnline localize my-images --camera camera.toml --gps log.nmea

      firnline localize phone-photos --camera camera.toml --gps gnss_log.txt

      firnline localize video-frames --frame-rate 30 --gps fixes.csv --columns time=t,lat=phi,lon=lambda

      firnline localize my-images --gps track.gpx --set localization.landmark_thinning=information

      firnline localize glacier-drive --gps log.ubx --epoch 14400

      firnline localize drive.bag --topic /left/image_raw --viewer drive.rrd

    Written are trajectory.tum and health.csv, landmarks.csv, the pictures map.png and tracks.png,
    with fixes also trajectory.csv (covariances), online_trajectory.csv (the causal path),
    track.gpkg and landmarks.gpkg in their CRS, and with a reference errors.png. No landmarks are
    written where the fixes contradict the images so much that the path is that of the fixes. Without fixes the
    path is relative to the first image, and path.csv has its standard deviations. A folder of
    images takes its times from frames.csv (time_s,file), times.txt, the names of the files or
    EXIF, its calibration from camera.toml (see firnline calibrate) or the focal length in EXIF,
    positions in EXIF as fixes, and wheels.csv and inertial.csv where they are there.
    """
    from firnline.cli.progress import counted

    if dry_run:
        print_result(localizing.preview_localization(request))
        return
    with counted(quiet=quiet) as progress:
        made = localizing.localize(request, progress)
    print_result(made.write(), as_json=as_json)
