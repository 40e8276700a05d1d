"""Formats in which `export` writes the drives and the world of a run: one table.

A format is added by a row of `RUN_FORMATS` and a function that opens the run: it refuses what the format cannot hold
before anything is written, and returns what writes the file.
"""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from firnline.actions.interface import needs_live_extra
from survey import ConfigError
from survey.core.replacement import replacing_folder

if TYPE_CHECKING:
    from sim.config.mission import MissionConfig
    from survey import Recording, Trajectory

_BAG_FILES = ("metadata.yaml", "*.db3")
_EUROC_FILES = ("mav0/*",)
_KITTI_FILES = ("calib.txt", "times.txt", "poses.txt", "image_0/*", "velodyne/*")


class OpenedRun(NamedTuple):
    """What is to be written: a function that writes it and returns a sentence about it, and what it leaves out."""

    write: Callable[[Path], str]
    notes: tuple[str, ...] = ()


class RunFormat(NamedTuple):
    """Format of a run.

    `name`: for ``--as``. `suffix`: ending of the file; none for a folder. `open`: called with the run and the number
    of a rover. `own`: patterns of the files in the folder.
    """

    name: str
    suffix: str
    open: Callable[[Path, int | None], OpenedRun]
    own: tuple[str, ...] = ()


class _Drive(NamedTuple):
    """Drive of one rover: recording, real path and mission, and the folder of its files."""

    recording: "Recording"
    real: "Trajectory"
    mission: "MissionConfig"
    folder: Path


def _drive(source: Path, rover: int | None) -> _Drive:
    """Read the drive of a rover; the run has to be simulated, and nothing more."""
    from sim.mission.fleet import drive_folders
    from sim.mission.runs import read_mission
    from survey import Recording, Trajectory
    from survey.core.run_folder import RunFolder

    run = RunFolder.find(source)
    folders = drive_folders(run.verified("simulate"))
    if not 0 <= (rover or 0) < len(folders) or (rover is None and len(folders) > 1):
        found = "no rover was chosen" if rover is None else f"there is no rover {rover}"
        raise ConfigError(
            f"{found}, and the run has {len(folders)}; choose one with --rover 0 to {len(folders) - 1}."
        )
    run.config_text()  # checked against the manifest
    folder = folders[rover or 0]
    recording = Recording.read(folder / "recording")
    real = Trajectory.read(folder / "truth" / "trajectory.tum", recording.crs)
    return _Drive(recording, real, read_mission(run.path / "config.toml"), folder)


def _bag(source: Path, rover: int | None) -> OpenedRun:
    from survey.interchange.bags import require_rosbags
    from survey.interchange.drive_bags import bag_notes, write_bag

    require_rosbags("writing a bag")
    drive = _drive(source, rover)
    gauge_m = drive.mission.physics.track_gauge_m

    def write(out: Path) -> str:
        counts = write_bag(drive.recording, out, truth=drive.real, track_gauge_m=gauge_m)
        return ", ".join(f"{topic} {n}" for topic, n in counts.items())

    return OpenedRun(write, bag_notes(drive.recording, drive.real, gauge_m))


def _foxglove(source: Path, rover: int | None) -> OpenedRun:
    if rover is not None:
        raise ConfigError("the file holds all rovers; leave --rover out.")
    with needs_live_extra():
        from live.mcap_files import write_drive_mcap, write_run_mcap
    from survey.core.run_folder import RunFolder

    if source.is_dir():
        RunFolder.find(source).verify("simulate")

    def write(out: Path) -> str:
        counts = (
            write_run_mcap(RunFolder.find(source), out) if source.is_dir() else write_drive_mcap(source, out)
        )
        return ", ".join(f"{topic} {n}" for topic, n in counts.items())

    return OpenedRun(write)


def _euroc(source: Path, rover: int | None) -> OpenedRun:
    from survey.interchange.layouts import write_euroc

    return _images(_drive(source, rover), write_euroc, _EUROC_FILES)


def _kitti(source: Path, rover: int | None) -> OpenedRun:
    from survey.interchange.layouts import write_kitti_sequence

    return _images(_drive(source, rover), write_kitti_sequence, _KITTI_FILES)


def _images(
    drive: _Drive, layout: "Callable[[Recording, Path, Trajectory], None]", own: tuple[str, ...]
) -> OpenedRun:
    """Return what writes images and real poses in a layout of folders, whose own files are replaced."""
    from survey.interchange.layouts import recorded_images

    frames, _ = recorded_images(drive.recording)

    def write(out: Path) -> str:
        with replacing_folder(out, own=own) as draft:
            layout(drive.recording, draft, drive.real)
        return f"{len(frames)} images"

    return OpenedRun(write)


def _world(kind: str) -> Callable[[Path, int | None], OpenedRun]:
    """Return what opens the ground of a run for one kind of world file; the rover is that of the spawn pose."""

    def opened(source: Path, rover: int | None) -> OpenedRun:
        from sim.world.world_files import WorldModel, write_glb, write_obj, write_sdf
        from survey import Truth
        from survey.io.vector import read_features

        drive = _drive(source, rover)
        mission, hazards = drive.mission, drive.folder / "hazards.geojson"
        marks = []
        if hazards.exists():
            found = read_features(hazards, what="the hazards")
            marks = list(zip(found.attributes["kind"].tolist(), found.geometry, strict=True))
        world = WorldModel(
            mission.name,
            Truth.read(drive.folder / "truth").dem,
            mission.appearance,
            mission.scenery.wind_from_deg,
            mission.site_seed,
            marks,
            drive.real.position[0],
            drive.real.quaternion[0],
            mission.scenery.surface,
            mission.scenery.snow_cover,
        )
        write = {".sdf": write_sdf, ".glb": write_glb, ".obj": write_obj}[kind]
        return OpenedRun(lambda out: write(world, out))

    return opened


RUN_FORMATS = (
    RunFormat("foxglove", ".mcap", _foxglove),
    RunFormat("ros1", ".bag", _bag),
    RunFormat("ros2", "", _bag, _BAG_FILES),
    RunFormat("ros2", ".mcap", _bag),
    RunFormat("euroc", "", _euroc, _EUROC_FILES),
    RunFormat("kitti", "", _kitti, _KITTI_FILES),
    RunFormat("sdf", ".sdf", _world(".sdf")),
    RunFormat("gltf", ".glb", _world(".glb")),
    RunFormat("obj", ".obj", _world(".obj")),
)
"""Every format of a run; of several with one ending the first is meant where no name is given."""
RUN_FORMAT_NAMES = tuple(dict.fromkeys(each.name for each in RUN_FORMATS))


def format_of_run(source: Path, out: Path, name: str | None) -> RunFormat | None:
    """Return the format in which a run is written, by its name or by the ending of the output; None for anything else.

    Folders have no ending, so they need a name. A log of a watched survey has the Foxglove format alone.
    """
    suffix = out.suffix.lower()
    if source.suffix == ".jsonl" and suffix == ".mcap" and name in (None, "foxglove"):
        return RUN_FORMATS[0]
    if not source.is_dir():
        if name in RUN_FORMAT_NAMES:
            raise ConfigError(f"--as {name} goes with run folders, and {source} is a file; leave it out.")
        return None
    fitting = [each for each in RUN_FORMATS if name in (None, each.name)]
    found = next((each for each in fitting if each.suffix == suffix and (name or suffix)), None)
    if found is None and (name in RUN_FORMAT_NAMES or not suffix):
        folders = ", ".join(each.name for each in RUN_FORMATS if not each.suffix)
        endings = ", ".join(each.suffix or "none (a folder)" for each in fitting)
        remedy = (
            f"--as {name} writes names with the ending {endings}"
            if name
            else f"name the kind of folder with --as: {folders}"
        )
        raise ConfigError(f"{out.name} has {f'the ending {suffix}' if suffix else 'no ending'}; {remedy}.")
    return found
