"""Run folders: the stages of a mission as folders that are complete or absent, so that a killed run can be resumed.

A stage writes into ``N-stage.partial``. When its files are on the disk, the folder is renamed and the manifest lists
the stage with the checksums of its files. A stage that the manifest does not list is not done. The run's name is a
digest of its configuration and its input files, so an edited mission gets a folder of its own.
"""

import fcntl
import hashlib
import json
import os
import shutil
import time
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from survey.core.documents import file_sha256, read_manifest, write_manifest
from survey.core.errors import InputError
from survey.core.files import replacing, synced, write_refusal
from survey.core.replacement import exchange, resolved

STAGES = ("plan", "simulate", "localize", "reconstruct", "score", "report")


@dataclass(frozen=True)
class RunFolder:
    """The folder of one mission.

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
        """Return the folder of a mission, existing or not.

        Parameters
        ----------
        runs, name, config_text, inputs
            See `open`.

        Returns
        -------
        pathlib.Path
            ``<runs>/<name>/<run id>``.
        """
        return runs / name / _digest(config_text, inputs)[:12]

    @classmethod
    def open(
        cls,
        runs: Path,
        name: str,
        config_text: str,
        inputs: Mapping[str, str],
        facts: Mapping[str, Any],
        *,
        fresh: bool = False,
    ) -> "RunFolder":
        """Create the folder of a configuration, or open it again.

        Parameters
        ----------
        runs : pathlib.Path
            The folder of all runs; created when it is missing.
        name : str
            The mission's name.
        config_text : str
            The resolved configuration.
        inputs : mapping of str to str
            SHA-256 of the input files by name.
        facts : mapping of str to Any
            Seed, versions and the like, for the manifest.
        fresh : bool
            Write configuration and manifest again, so that no stage counts as done. The files of
            the old stages stay until the new ones replace them.

        Returns
        -------
        RunFolder
            The folder, its configuration checked.

        Raises
        ------
        InputError
            The folder cannot be created or written to, another process works in it, or its
            manifest or configuration was changed.
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
            if fresh or not run._is_begun:
                run._begin(config_text, inputs, facts)
        run.config_text()
        run._point_latest()
        return run

    @classmethod
    def find(cls, path: Path) -> "RunFolder":
        """Return an existing run.

        Parameters
        ----------
        path : pathlib.Path
            A run folder, or the folder of a mission with a ``latest`` link in it.

        Returns
        -------
        RunFolder
            The folder; nothing in it is checked yet.

        Raises
        ------
        InputError
            There is no manifest.
        """
        for candidate in (path, path / "latest"):
            if (candidate / "manifest.json").is_file():
                return cls(resolved(candidate))
        raise InputError(
            f"{path} is no run folder (it holds no manifest.json); name a folder that `firnline run` made."
        )

    @property
    def manifest(self) -> dict[str, Any]:
        """The manifest: configuration, seed, versions, inputs, and for each stage its time and checksums."""
        return read_manifest(self._manifest_file)

    def config_text(self) -> str:
        """Return the resolved configuration, checked against the manifest.

        Returns
        -------
        str
            The content of ``config.toml``.

        Raises
        ------
        InputError
            ``config.toml`` is missing or was changed.
        """
        check_files(self.path, self.manifest["files_sha256"], "the run was begun; run again with --fresh")
        return (self.path / "config.toml").read_text(encoding="utf-8")

    def folder(self, stage: str) -> Path:
        """Return the folder of a stage.

        Parameters
        ----------
        stage : str
            One of `STAGES`.

        Returns
        -------
        pathlib.Path
            ``<run>/<number>-<stage>``, existing or not.
        """
        return self.path / f"{STAGES.index(stage) + 1}-{stage}"

    def has(self, stage: str) -> bool:
        """Return whether a stage is done.

        Parameters
        ----------
        stage : str
            One of `STAGES`.

        Returns
        -------
        bool
            True when the manifest lists it and its folder exists.
        """
        return stage in self.manifest["stages"] and self.folder(stage).is_dir()

    @contextmanager
    def stage(self, name: str) -> Iterator[Path]:
        """Yield an empty folder for the files of a stage; it becomes the stage's folder when the body ends.

        An old folder of the stage stays until then. The stages after it count as not done from
        then on. No other process may open the run meanwhile.

        Parameters
        ----------
        name : str
            One of `STAGES`.

        Yields
        ------
        pathlib.Path
            The draft. Errors of the body pass through unchanged and leave the run as it was.

        Raises
        ------
        InputError
            The draft cannot be created or stored, or another process works in the run.
        """
        draft = self.folder(name).with_name(f"{self.folder(name).name}.partial")
        with self._held():
            began = time.perf_counter()
            self._create(draft)
            try:
                yield draft
                self._finish(name, draft, began)
            finally:
                shutil.rmtree(draft, ignore_errors=True)

    def verify(self, stage: str) -> None:
        """Check the files of a finished stage against their checksums.

        Parameters
        ----------
        stage : str
            A stage that is done.

        Raises
        ------
        InputError
            A file is missing, was changed or was added.
        """
        record = self.manifest["stages"].get(stage)
        if record is None:
            raise InputError(
                f"the stage {stage} of the run {self.path} is not done; finish it with firnline run."
            )
        folder = self.folder(stage)
        check_files(
            folder, record["files_sha256"], f"the stage {stage} wrote it; run again with --from {stage}"
        )
        added = files_of(folder) - set(record["files_sha256"])
        if added:
            raise InputError(
                f"{folder / min(added)} was added after the stage {stage} was done; remove it, or run again with --from {stage}."
            )

    def verified(self, stage: str) -> Path:
        """Check the files of a finished stage and return its folder.

        Parameters
        ----------
        stage : str
            A stage that has to be done.

        Returns
        -------
        pathlib.Path
            The stage's folder.

        Raises
        ------
        InputError
            The stage is not done, or its files were changed.
        """
        self.verify(stage)
        return self.folder(stage)

    def redo_from(self, stage: str, facts: Mapping[str, Any]) -> None:
        """Let a stage and all that follow it count as not done.

        Parameters
        ----------
        stage : str
            One of `STAGES`. Its files and those of the later stages stay until they are replaced.
        facts : mapping of str to Any
            Facts of this process that replace those in the manifest (versions).
        """
        with self._held():
            self._unlist_from(stage, facts)

    @property
    def log_file(self) -> Path:
        """Log of the run, see `survey.core.documents`."""
        return self.path / "log.jsonl"

    @property
    def _manifest_file(self) -> Path:
        return self.path / "manifest.json"

    @property
    def _is_begun(self) -> bool:
        """Whether there is a manifest; stages without one are refused when it is read."""
        return self._manifest_file.exists() or any(self.folder(stage).exists() for stage in STAGES)

    def _begin(self, config_text: str, inputs: Mapping[str, str], facts: Mapping[str, Any]) -> None:
        with replacing(self.path / "config.toml") as draft:
            draft.write_text(config_text, encoding="utf-8")
        write_manifest(
            self._manifest_file,
            {
                "config_sha256": _digest(config_text, inputs),
                **facts,
                "inputs_sha256": dict(inputs),
                "files_sha256": {"config.toml": file_sha256(self.path / "config.toml")},
                "stages": {},
            },
        )

    def _create(self, draft: Path) -> None:
        shutil.rmtree(draft, ignore_errors=True)
        try:
            draft.mkdir()
        except OSError as error:
            raise write_refusal(draft, error) from error

    def _finish(self, name: str, draft: Path, began: float) -> None:
        """Put the draft in the place of the stage and list it in the manifest, without the stages after it."""
        try:
            sync_tree(draft)
            files = {file: file_sha256(draft / file) for file in sorted(files_of(draft))}
            self._unlist_from(name, {})
            exchange(draft, self.folder(name))
            synced(self.path)
        except OSError as error:
            raise write_refusal(self.folder(name), error) from error
        manifest = self.manifest
        seconds = round(time.perf_counter() - began, 3)
        manifest["stages"][name] = {"wall_s": seconds, "files_sha256": files}
        write_manifest(self._manifest_file, manifest)

    def _unlist_from(self, stage: str, facts: Mapping[str, Any]) -> None:
        """Remove a stage and all that follow it from the manifest, where it lists any, and put facts in."""
        manifest = self.manifest
        listed = [name for name in STAGES[STAGES.index(stage) :] if name in manifest["stages"]]
        for name in listed:
            del manifest["stages"][name]
        if listed or facts:
            write_manifest(self._manifest_file, {**manifest, **facts})

    def _held(self) -> AbstractContextManager[None]:
        """Keep other processes out of the run."""
        return locked(
            self.path,
            f"another process is working on the run {self.path}; wait for it, stop it, or choose another place with --runs.",
        )

    def _point_latest(self) -> None:
        link = self.path.parent / "latest"
        draft = self.path.parent / f".latest-{os.getpid()}"
        draft.unlink(missing_ok=True)
        draft.symlink_to(self.path.name)
        draft.replace(link)


def _digest(config_text: str, inputs: Mapping[str, str]) -> str:
    return hashlib.sha256(json.dumps([config_text, dict(sorted(inputs.items()))]).encode()).hexdigest()


_SYNCED_AT_ONCE = 16


def files_of(folder: Path) -> set[str]:
    """Return the paths of all files of a folder, relative to it."""
    return {str(file.relative_to(folder)) for file in folder.rglob("*") if file.is_file()}


def check_files(folder: Path, expected: Mapping[str, str], remedy: str) -> None:
    """Check files of a folder against their checksums.

    Raises
    ------
    InputError
        A file is missing or was changed; `remedy` ends its sentence.
    """
    for name, digest in expected.items():
        file = folder / name
        if not file.is_file() or file_sha256(file) != digest:
            raise InputError(f"{file} is missing or was changed after {remedy}.")


def sync_tree(folder: Path) -> None:
    """Put all files on the disk; many requests at once take a twentieth of the time of one after the other."""
    with ThreadPoolExecutor(_SYNCED_AT_ONCE) as pool:
        for _ in pool.map(synced, folder.rglob("*")):
            pass
    synced(folder)


@contextmanager
def locked(folder: Path, refusal: str) -> Iterator[None]:
    """Lock a folder against other processes; the lock of a killed process is released.

    Raises
    ------
    InputError
        Another process has locked it; `refusal` is the sentence.
    """
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        _lock(descriptor, refusal)
        yield
    finally:
        os.close(descriptor)


def _lock(descriptor: int, refusal: str) -> None:
    """Take the lock of an open folder without waiting."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise InputError(refusal) from error
