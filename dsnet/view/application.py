"""What the served page can ask for: to read a motion file, a shape in words, and exports."""

from __future__ import annotations

import importlib.util
import shlex
import shutil
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Protocol

from bridge.errors import DsnetError
from bridge.runs import Run
from dsnet.exporters.formats import FORMATS
from dsnet.prediction.controls import Controls
from dsnet.view.clip_list import READING, Clip, clip_list_of, open_file, path_title
from dsnet.view.export_job import ExportJob
from dsnet.view.scene import Scene

LARGEST_FILE = 128 << 20
"""Bytes of a motion file that the page may send; characters with textures are in some."""
_CHUNK = 1 << 20
_LONGEST_NAME = 120
SHOWN = ("gain", "part_gain", "betas", "loop", "floor")
"""Those that the page's own knobs say of what is shown."""
_NUMBERS: dict[str, Callable[[str], Any]] = {"motion_fps": float, "person": int, "gain": float}


class Readable(Protocol):
    """A request's body."""

    def read(self, size: int, /) -> bytes: ...


@dataclass(eq=False)
class Application:
    """The scenes of one server, dropped files, and the export that runs.

    Files lie in a temporary folder, which `opened` removes at the end.
    """

    run: Run | None
    controls: Controls
    folder: Path
    scenes: list[Scene]
    job: ExportJob | None = None
    _files: int = 0
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def receive(self, name: str, stream: Readable, size: int) -> dict[str, Any]:
        """Keep a file of `size` bytes that was dropped onto the page, and read it."""
        if size > LARGEST_FILE:
            raise DsnetError(
                f"{Path(name).name}, {size >> 20} MB",
                f"a motion file of at most {LARGEST_FILE >> 20} MB",
                "Pass it by --motion FILE.",
            )
        with self._lock:
            self._files += 1
            (folder := self.folder / str(self._files)).mkdir()
        path = folder / _safe_name(name)
        try:
            with path.open("wb") as file:
                while size and (chunk := stream.read(min(size, _CHUNK))):
                    file.write(chunk)
                    size -= len(chunk)
            if size:
                raise DsnetError(
                    f"{path.name}, of which {size} bytes are missing", "all of it", "Drop it again."
                )
            return self._read(path, self.controls)
        except BaseException:
            shutil.rmtree(folder)
            raise

    def read_again(self, scene: int, number: int, reading: Mapping[str, str]) -> dict[str, Any]:
        """Read a motion's file by other options, words by their names in `READING`."""
        clip = self._clip(scene, number)
        if clip.path is None:
            raise DsnetError("a motion of a run", "one of a file", "Choose another.")
        return self._read(clip.path, _with(clip.controls, reading, READING), (scene, number))

    def _read(
        self, path: Path, controls: Controls, before: tuple[int, int] | None = None
    ) -> dict[str, Any]:
        """Put a file's motion into the scene of its body, in place of what it was `before`."""
        controls.check()
        with self._lock, self._without_folder():
            best, clip = open_file(
                self.run, path, controls, "*Frames a second*", "*Smoothing: automatic*"
            )
            clip = replace(clip, told=tuple(map(self._shortened, clip.told or ())))
            title = path_title(path)
            clip_list = clip_list_of(self.run, best, {title: clip}, controls)
            new = Scene(clip_list)
            for at, scene in enumerate(self.scenes):
                if scene.body_model == new.body_model:
                    number = before[1] if before and before[0] == at else None
                    number = scene.put(title, clip, number)
                    return {"scene": at, "number": number, "entry": scene.entry(number)}
            self.scenes.append(new)
            return {"scene": len(self.scenes) - 1, "number": 0, "entry": new.entry(0)}

    @contextmanager
    def _without_folder(self) -> Iterator[None]:
        """Refusals that name a file without the folder that it is kept in."""
        try:
            yield
        except DsnetError as error:
            parts = (error.received, error.expected, error.remedy)
            raise DsnetError(*map(self._shortened, parts)) from error

    def _shortened(self, text: str) -> str:
        for number in range(self._files, 0, -1):
            text = text.replace(f"{self.folder / str(number)}/", "")
        return text

    def shape(self, scene: int, words: str) -> dict[str, Any]:
        """Betas of a shape in words: `tall heavy`, `height=182 weight=80`."""
        asked = Controls(shape=(words,))
        asked.check()
        betas = asked.requested_betas(self.scenes[scene].body)
        return {"betas": [] if betas is None else betas.tolist()}

    def formats(self) -> list[dict[str, str]]:
        """What a motion can be exported as; `missing` is the extra that is not installed."""
        return [
            {
                "name": name,
                "title": one.title or name,
                "missing": (one.extra or "") * _is_missing(one),
            }
            for name, one in FORMATS.items()
            if one.needs_motion
        ]

    def export(
        self, scene: int, number: int, to: str, predictors: list[str], shown: Mapping[str, Any]
    ) -> dict[str, Any]:
        """Begin an export of a motion as it is shown, and give the command that does the same.

        Of several `predictors` formats that show one body have the first.
        """
        clip = self._clip(scene, number)
        if clip.path is None:
            raise DsnetError(
                "an aligned sequence of a run", "a motion of a file", "Choose or drop another."
            )
        if to not in FORMATS or not FORMATS[to].needs_motion:
            raise DsnetError(f"format {to!r}", "one of the list", "Choose another.")
        controls = _with(clip.controls, shown, SHOWN)
        controls.check()
        words = ["export", "--to", to, "--motion", str(clip.path), *_words(controls)]
        if self.run is not None:
            count = len(predictors) if FORMATS[to].several else 1
            words += ["--run", self.run.name, "--predictor", *predictors[:count]]
        suffix = "".join(FORMATS[to].suffixes[:1])
        name = f"{path_title(clip.path)}{suffix}"
        with self._lock:
            if self.job and self.job.runs:
                raise DsnetError("a second export", "one at a time", "Wait, or cancel it.")
            self.end_export()
            (folder := self.folder / "exports").mkdir(exist_ok=True)
            self.job = ExportJob(words, folder / name)
        said = ["dsnet", *words, "--out", name]
        return {"command": self._shortened(shlex.join(said))}

    def export_state(self) -> dict[str, Any] | None:
        """How far the export is; None where there is none."""
        state = self.job and self.job.state()
        return state and state | {"told": [*map(self._shortened, state["told"])]}

    def end_export(self) -> None:
        """Cancel what runs, and remove what was written."""
        if self.job:
            self.job.end()
            self.job = None

    def _clip(self, scene: int, number: int) -> Clip:
        return self.scenes[scene].clip(number)


@contextmanager
def opened(scene: Scene, run: Run | None, controls: Controls) -> Iterator[Application]:
    """An application whose files are gone when the block ends."""
    with TemporaryDirectory(prefix="dsnet-view-") as folder:
        application = Application(run, controls, Path(folder), [scene])
        try:
            yield application
        finally:
            application.end_export()


def _safe_name(name: str) -> str:
    """The name of a dropped file without folders and without what is no text of a name."""
    bare = "".join(c if c.isprintable() else "_" for c in name.replace("\\", "/").split("/")[-1])
    stem, dot, suffix = bare.rpartition(".")
    bare = f"{stem[-_LONGEST_NAME:]}{dot}{suffix[:20]}"
    return bare if bare.strip(".") else "motion"


def _is_missing(chosen: Any) -> bool:
    return chosen.package is not None and importlib.util.find_spec(chosen.package) is None


def _with(controls: Controls, words: Mapping[str, Any], known: tuple[str, ...]) -> Controls:
    """Controls with what the page says, in words; an empty word is the default."""
    defaults = {one.name: one.default for one in fields(Controls)}
    said: dict[str, Any] = {}
    for name, word in words.items():
        if name not in known:
            raise DsnetError(f"{name}", f"one of {', '.join(known)}", "Reload the page.")
        said[name] = defaults[name] if word in ("", None) else _value(name, word)
    return Controls.of({**vars(controls), **said})


def _value(name: str, word: Any) -> Any:
    if name == "smooth_hz" and word != "auto":
        return _number(name, word, float)
    return _number(name, word, _NUMBERS[name]) if name in _NUMBERS else word


def _number(name: str, word: Any, kind: Callable[[str], Any]) -> Any:
    try:
        return kind(word)
    except (TypeError, ValueError):
        raise DsnetError(f"{name} {word!r}", "a number", "Correct it.") from None


def _words(controls: Controls) -> list[str]:
    """Controls as words of the command line."""
    words: list[str] = []
    given = controls.given() | ({"body": controls.body} if controls.body else {})
    for name, value in given.items():
        flag = f"--{name.replace('_', '-')}"
        if isinstance(value, bool):
            words += [flag]
        elif isinstance(value, tuple):
            words += [flag, *map(str, value)]
        else:
            words += [f"{flag}={value}"]  # betas may begin with a minus
    return words
