"""Run folders: a mission's stages as whole folders, so that a killed run goes on where it was.

A stage writes into ``N-stage.partial``; when all is on the disk the folder is renamed.
A folder without ``.partial`` is whole. The run's name is made of its configuration and
its input files, so an edited mission gets a folder of its own.
"""

import fcntl
import hashlib
import json
import os
import shutil
import time
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from survey.core.errors import InputError
from survey.core.files import replacing, synced

_SYNCED_AT_ONCE = 16
STAGES = ("plan", "simulate", "localize", "reconstruct", "score", "report")


def checksum(path: Path) -> str:
    """Return the SHA-256 of a file as hexadecimal digits."""
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


@dataclass(frozen=True)
class RunFolder:
    """One mission's folder.

    Parameters
    ----------
    path : pathlib.Path
        ``<runs>/<name>/<run id>``.

    Examples
    --------
    >>> import tempfile
    >>> run = RunFolder.open(Path(tempfile.mkdtemp()), "demo", "seed = 1", {}, {})
    >>> with run.stage("plan") as folder:
    ...     _ = (folder / "route.txt").write_text("north")
    >>> run.has("plan"), run.has("simulate")
    (True, False)
    """

    path: Path

    @classmethod
    def place(cls, runs: Path, name: str, config_text: str, inputs: Mapping[str, str]) -> Path:
        """Return where a mission is kept, whether it is there yet or not."""
        return runs / name / _digest(config_text, inputs)[:12]

    @classmethod
    def open(
        cls, runs: Path, name: str, config_text: str, inputs: Mapping[str, str], facts: Mapping[str, Any]
    ) -> "RunFolder":
        """Create the folder that belongs to a configuration, or find it again.

        Parameters
        ----------
        runs : pathlib.Path
            The folder of all runs; made when it is missing.
        name : str
            The mission's name.
        config_text : str
            The resolved configuration.
        inputs : mapping of str to str
            Checksums of the input files by name.
        facts : mapping of str to Any
            Seed, versions and the like, for the manifest.

        Raises
        ------
        InputError
            When the folder cannot be made or written to, or another process is at work in it.
        """
        run = cls(cls.place(runs, name, config_text, inputs))
        try:
            run.path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(
                f"the run folder {run.path} cannot be made ({error.strerror}); choose another place with --runs."
            ) from error
        with run._held():
            for leftover in [*run.path.glob("*.partial"), *run.path.glob(".*")]:
                shutil.rmtree(leftover, ignore_errors=True)
        if not run._manifest_file.exists():
            _write_text(run.path / "config.toml", config_text)
            run._save(
                {
                    "config_sha256": _digest(config_text, inputs),
                    **facts,
                    "inputs_sha256": dict(inputs),
                    "stages": {},
                }
            )
        run._point_latest()
        return run

    @classmethod
    def find(cls, path: Path) -> "RunFolder":
        """Return an existing run: its folder, or a mission's folder with a ``latest`` in it."""
        for candidate in (path, path / "latest"):
            if (candidate / "manifest.json").is_file():
                return cls(candidate.resolve())
        raise InputError(
            f"{path} is no run folder (it holds no manifest.json); name a folder that `firnline run` made."
        )

    @property
    def manifest(self) -> dict[str, Any]:
        """The manifest: configuration, seed, versions, inputs, and for each stage its time and checksums."""
        try:
            content: dict[str, Any] = json.loads(self._manifest_file.read_text(encoding="utf-8"))
        except (OSError, ValueError) as error:
            raise InputError(
                f"the manifest {self._manifest_file} is damaged ({error}); run again with --fresh."
            ) from error
        return content

    def folder(self, stage: str) -> Path:
        """Return where a finished stage keeps its files."""
        return self.path / f"{STAGES.index(stage) + 1}-{stage}"

    def has(self, stage: str) -> bool:
        """Tell whether a stage is finished."""
        return self.folder(stage).is_dir()

    @contextmanager
    def stage(self, name: str) -> Iterator[Path]:
        """Yield an empty folder for a stage's files; it becomes the stage's own when all went well.

        No other process may open the run meanwhile: two would clear away each other's drafts.
        """
        with self._held():
            began = time.perf_counter()
            with self._drafted(name) as draft:
                yield draft
            self._record(name, time.perf_counter() - began)

    @contextmanager
    def _drafted(self, name: str) -> Iterator[Path]:
        target = self.folder(name)
        draft = target.with_name(f"{target.name}.partial")
        shutil.rmtree(draft, ignore_errors=True)
        try:
            draft.mkdir()
            yield draft
            _sync_tree(draft)
            draft.replace(target)
            synced(self.path)
        except OSError as error:
            shutil.rmtree(draft, ignore_errors=True)
            raise InputError(
                f"the stage {name} could not be stored in {self.path} ({error.strerror or error}); free space or choose another place."
            ) from error
        except BaseException:
            shutil.rmtree(draft, ignore_errors=True)
            raise

    @contextmanager
    def _held(self) -> Iterator[None]:
        """Keep other processes out of the run; one that is killed keeps nobody out."""
        folder = os.open(self.path, os.O_RDONLY)
        try:
            self._lock(folder)
            yield
        finally:
            os.close(folder)

    def _lock(self, folder: int) -> None:
        try:
            fcntl.flock(folder, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise InputError(
                f"another process is working on the run {self.path}; wait for it, stop it, or choose another place with --runs."
            ) from error

    def verify(self, stage: str) -> None:
        """Refuse when a file of a finished stage is missing or differs from what was written."""
        record = self.manifest["stages"].get(stage)
        if record is None:  # killed between the rename and the manifest: the folder is whole
            self._record(stage, None)
            return
        for name, expected in record["files_sha256"].items():
            file = self.folder(stage) / name
            if not file.is_file() or checksum(file) != expected:
                raise InputError(
                    f"{file} is missing or was changed after the stage {stage} wrote it; run again with --from {stage}."
                )

    def discard_from(self, stage: str) -> None:
        """Delete a stage and all that follow it."""
        manifest = self.manifest
        for name in STAGES[STAGES.index(stage) :]:
            shutil.rmtree(self.folder(name), ignore_errors=True)
            manifest["stages"].pop(name, None)
        self._save(manifest)

    @property
    def _manifest_file(self) -> Path:
        return self.path / "manifest.json"

    def _record(self, stage: str, seconds: float | None) -> None:
        folder = self.folder(stage)
        files = {str(f.relative_to(folder)): checksum(f) for f in sorted(folder.rglob("*")) if f.is_file()}
        manifest = self.manifest
        manifest["stages"][stage] = {
            "wall_s": None if seconds is None else round(seconds, 3),
            "files_sha256": files,
        }
        self._save(manifest)

    def _save(self, manifest: Mapping[str, Any]) -> None:
        _write_text(self._manifest_file, json.dumps(manifest, indent=2, ensure_ascii=False) + "\n")

    def _point_latest(self) -> None:
        link = self.path.parent / "latest"
        draft = self.path.parent / f".latest-{os.getpid()}"
        draft.unlink(missing_ok=True)
        draft.symlink_to(self.path.name)
        draft.replace(link)


def _digest(config_text: str, inputs: Mapping[str, str]) -> str:
    return hashlib.sha256(json.dumps([config_text, dict(sorted(inputs.items()))]).encode()).hexdigest()


def _write_text(path: Path, text: str) -> None:
    with replacing(path) as draft:
        draft.write_text(text, encoding="utf-8")


def _sync_tree(folder: Path) -> None:
    """Put all files on the disk; thousands asked for together take a twentieth of the time of one after the other."""
    with ThreadPoolExecutor(_SYNCED_AT_ONCE) as pool:
        for _ in pool.map(synced, folder.rglob("*")):
            pass
    synced(folder)
