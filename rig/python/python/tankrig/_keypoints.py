"""Keypoints of other programs, read by the libraries that own their formats, and handed to those that work on them."""

from __future__ import annotations

import csv
import os
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from . import _native
from ._optional import needed
from ._run import Run
from ._tables import AXES, Floats, Trajectory
from .errors import DataError, InputError

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True, eq=False)
class Keypoints:
    """Marks in the pictures of a film, one animal or mechanism; not metres yet.

    Attributes:
        names: body parts or nodes, length K.
        position_px: column and row, the centre of the top left pixel at (0, 0), shape (N, K, 2); NaN where nothing was marked.
        confidence: 0 to 1, shape (N, K); 1 where made by hand.
        image: numbers of the images in their film, shape (N,).
        fps: images per second; ``None`` where the file does not say.
    """

    names: list[str]
    position_px: Floats
    confidence: Floats
    image: np.ndarray
    fps: float | None = None

    def to_trajectory(
        self,
        config: str | os.PathLike[str],
        out: str | os.PathLike[str],
        *,
        keypoints: str | None = None,
        model: str | os.PathLike[str] | None = None,
        fps: float | None = None,
        times: str | os.PathLike[str] | None = None,
        least_likelihood: float = 0.6,
        std_px: float | None = None,
    ) -> Trajectory:
        """Puts them into metres by the calibration of a rig config, as ``rig import`` does, and writes them to ``out``.

        Args:
            config: any rig config: its ``[calibration]`` and rate.
            out: the ``trajectory.csv`` to write; ``<out>.frames.csv`` beside it says why there are gaps.
            keypoints: which parts are P0, P1, ...: ``"base,elbow,tip"``, or ``"P1=elbow,P2=tip"``; left out: parts called so.
            model: the mechanism's model; left out: the config's.
            fps: images per second; left out: the file's own, else the config's.
            times: a table ``file,time_s`` of when images were taken; wins over any rate.
            least_likelihood: marks below are gaps.
            std_px: one sigma of a mark per axis [px]; left out: none is written, and a fit takes it from the keypoints.

        Raises:
            InputError: where config, names or times do not fit.
            DataError: where not one keypoint can be used.
        """
        with tempfile.TemporaryDirectory(prefix="tankrig-") as folder:
            table = Path(folder) / "keypoints.csv"
            self._write(table)
            _native.import_keypoints(
                table,
                config,
                out,
                model=model,
                keypoints=keypoints,
                fps=fps if fps is not None else (self.fps if times is None else None),
                times=times,
                least_likelihood=least_likelihood,
                std_px=std_px,
            )
        return Trajectory.read(out)

    def _write(self, path: Path) -> None:
        """As DeepLabCut's CSV, which ``rig import`` reads."""
        parts = [[name] * 3 for name in self.names]
        with path.open("w", newline="") as file:
            rows = csv.writer(file)
            rows.writerow(["scorer", *["tankrig"] * 3 * len(self.names)])
            rows.writerow(["bodyparts", *sum(parts, [])])
            rows.writerow(["coords", *["x", "y", "likelihood"] * len(self.names)])
            for number, places, sure in zip(self.image, self.position_px, self.confidence):
                marks = [_mark(x, y, how) for (x, y), how in zip(places, sure)]
                rows.writerow([int(number), *sum(marks, [])])

    def __len__(self) -> int:
        return len(self.image)

    def __repr__(self) -> str:
        return f"Keypoints({len(self)} images, {', '.join(self.names)})"


def _mark(x: float, y: float, how: float) -> list[str]:
    if not (np.isfinite(x) and np.isfinite(y)):
        return ["", "", "0"]
    return [repr(float(x)), repr(float(y)), repr(float(how) if np.isfinite(how) else 1.0)]


def from_sleap(path: str | os.PathLike[str], track: str | int | None = None) -> Keypoints:
    """Reads SLEAP's ``.slp`` by ``sleap-io``; what was labelled by hand where an image has both.

    Args:
        path: the file.
        track: name or place of the track; needed where there are several.
    """
    return _of_labels(_loaded("load_slp", path), path, track)


def from_coco(path: str | os.PathLike[str], track: str | int | None = None) -> Keypoints:
    """Reads COCO keypoints (``.json``) by ``sleap-io``; arguments as for ``from_sleap``."""
    return _of_labels(_loaded("load_coco", path), path, track)


def from_nwb(path: str | os.PathLike[str], track: str | int | None = None) -> Keypoints:
    """Reads NWB with ``ndx-pose`` by ``sleap-io``; arguments as for ``from_sleap``."""
    return _of_labels(_loaded("load_nwb", path), path, track)


def _loaded(name: str, path: str | os.PathLike[str]) -> Any:
    library = needed("sleap_io", f"reading {path}", "sleap-io")
    load = getattr(library, name, None)
    if load is None:
        raise InputError(f"reading {path}: sleap-io {library.__version__} has no {name}; pip install --upgrade sleap-io")
    return _read(load, path, {"open_videos": False} if name == "load_slp" else {})


def _read(load: Any, path: str | os.PathLike[str], options: Mapping[str, Any]) -> Any:
    if not Path(path).is_file():
        raise InputError(f"reading {path}: it is not there")
    try:
        return load(os.fspath(path), **options)
    except ImportError as error:
        raise InputError(f"reading {path}: {error}; install what it names") from error
    except Exception as error:  # what these libraries raise for a damaged file is any of a dozen kinds
        raise InputError(f"reading {path}: {type(error).__name__}: {error}") from error


def _of_labels(labels: Any, path: str | os.PathLike[str], track: str | int | None) -> Keypoints:
    names = [node.name for node in labels.skeleton.nodes]
    if len(labels.videos) > 1:
        raise InputError(f"{path} is about {len(labels.videos)} films; keep one: `sleap_io` has `Labels.extract`")
    chosen = _track(labels, path, track)
    rows = {}
    for frame in labels:
        instances = [one for one in frame.instances if chosen is None or one.track is chosen]
        by_hand = [one for one in instances if not hasattr(one, "score")]
        instances = by_hand or instances
        if len(instances) > 1:
            what = f"image {frame.frame_idx} of {path} shows {len(instances)} of them without a track; say which is which in the tracker"
            raise InputError(what)
        if instances:
            points = instances[0].numpy()
            sure = instances[0].numpy(scores=True)[:, -1] if not by_hand else np.ones(len(points))
            rows[int(frame.frame_idx)] = (points[:, :2], sure)
    if not rows:
        raise DataError(f"{path} holds no marks" + (f" of track {track}" if track is not None else ""))
    first, last = min(rows), max(rows)
    image = np.arange(first, last + 1)
    position, confidence = np.full((len(image), len(names), 2), np.nan), np.zeros((len(image), len(names)))
    for number, (points, sure) in rows.items():
        position[number - first], confidence[number - first] = points, sure
    return Keypoints(names, position, confidence, image)


def _track(labels: Any, path: str | os.PathLike[str], track: str | int | None) -> Any:
    if track is None:
        if len(labels.tracks) > 1:
            raise InputError(f"{path} has tracks {', '.join(one.name for one in labels.tracks)}; say which with `track`")
        return None
    if isinstance(track, int) and 0 <= track < len(labels.tracks):
        return labels.tracks[track]
    for one in labels.tracks:
        if one.name == track:
            return one
    raise InputError(f"{path} has no track {track!r}, but {', '.join(one.name for one in labels.tracks) or 'none'}")


def from_deeplabcut(path: str | os.PathLike[str], individual: str | None = None) -> Keypoints:
    """Reads DeepLabCut's ``.h5`` or ``.csv`` by ``movement``.

    Args:
        path: the file.
        individual: which animal; needed where there are several.
    """
    load_poses = needed("movement.io.load_poses", f"reading {path}", "movement")
    return from_movement(_read(load_poses.from_dlc_file, path, {}), individual)


def from_movement(ds: xr.Dataset, individual: str | None = None) -> Keypoints:
    """Takes marks in pixels from a dataset of ``movement``, which reads DeepLabCut, SLEAP, LightningPose, Anipose and NWB.

    Args:
        ds: the dataset, times in images or in seconds at an even rate.
        individual: which animal; needed where there are several.
    """
    try:
        individuals = [str(name) for name in ds["individuals"].values]
        if individual is None and len(individuals) > 1:
            raise InputError(f"the dataset has {', '.join(individuals)}; say which with `individual`")
        if individual is not None and individual not in individuals:
            raise InputError(f"the dataset has no {individual!r}, but {', '.join(individuals)}")
        one = ds.sel(individuals=individual or individuals[0])
        position = one["position"].transpose("time", "keypoints", "space").sel(space=["x", "y"]).values
        names = [str(name) for name in ds["keypoints"].values]
        confidence = one["confidence"].transpose("time", "keypoints").values if "confidence" in one else np.ones(position.shape[:2])
        times = np.asarray(ds["time"].values, float)
    except KeyError as error:
        raise InputError(f"no dataset of poses as `movement` has them: {error}") from error
    fps = ds.attrs.get("fps")
    in_seconds = ds.attrs.get("time_unit") == "seconds" and fps
    image = np.rint(times * fps).astype(int) if in_seconds else np.rint(times).astype(int)
    if in_seconds and np.abs(times * fps - image).max(initial=0.0) > 0.25:
        raise InputError(f"the dataset's times are not those of {fps} images per second; write a table and give it as `times`")
    return Keypoints(names, np.asarray(position, float), np.asarray(confidence, float), image, float(fps) if fps else None)


def to_movement(of: Run | Trajectory) -> xr.Dataset:
    """A run's keypoints as a dataset that ``movement`` works on: dimensions time [s], space, keypoints, individuals; positions [m].

    What was not seen is NaN, with confidence 0; axes never observed are left out.
    """
    load_poses = needed("movement.io.load_poses", "a dataset of movement", "movement")
    trajectory = of.trajectory if isinstance(of, Run) else of
    places = [place for place, name in enumerate(trajectory.keypoints) if not name.endswith("_rad")]
    position = trajectory.position_m[:, places]
    axes = [axis for axis in range(3) if not np.isnan(position[:, :, axis]).all()]
    if len(axes) < 2 or len(trajectory) < 2:
        raise DataError(f"{trajectory} has positions along {len(axes)} axes; a dataset needs two, and two images")
    seen = np.isfinite(position[:, :, axes]).all(axis=2)
    steps = np.diff(trajectory.time_s)
    made = load_poses.from_numpy(
        position_array=np.moveaxis(position[:, :, axes], 2, 1)[..., np.newaxis],
        confidence_array=seen.astype(float)[..., np.newaxis],
        individual_names=["mechanism"],
        keypoint_names=[trajectory.keypoints[place] for place in places],
        fps=float(1.0 / np.median(steps)),
        source_software="rig",
    )
    # movement names the axes of a plane x and y; ours is x-z, z up
    ds: xr.Dataset = made.assign_coords(time=trajectory.time_s, space=[AXES[axis] for axis in axes])
    ds.attrs["space_unit"] = "m"
    return ds


def from_c3d(path: str | os.PathLike[str], keypoints: Mapping[str, str], *, axes: str = "xyz", start_s: float = 0.0) -> Trajectory:
    """Reads markers of a motion-capture system from a ``.c3d`` by the package ``c3d``; metres by the file's own unit.

    Args:
        path: the file.
        keypoints: which marker is which: ``{"P1": "elbow", "P2": "tip"}``.
        axes: which of the file's axes are our x, y, z, with a minus before one that is turned round: ``"x-zy"`` where the file's z comes
            towards the camera and its y is up.
        start_s: time of the file's first image [s].
    """
    library = needed("c3d", f"reading {path}")

    def load(name: str) -> Any:
        with open(name, "rb") as file:
            reader = library.Reader(file)
            labels = [label.strip() for label in reader.point_labels]
            unit = reader.get("POINT:UNITS")
            images = [np.asarray(points, float) for _, points, _ in reader.read_frames()]
            return labels, (unit.string_value.strip() if unit else "mm"), reader.point_rate, np.array(images)

    labels, unit, rate, images = _read(load, path, {})
    position = images[:, :, :3]
    # the format's own mark of a gap is an error below 0
    position[images[:, :, 3] < 0.0] = np.nan
    return _of_markers(path, labels, unit, start_s + np.arange(len(images)) / rate, position, keypoints, axes)


def from_trc(path: str | os.PathLike[str], keypoints: Mapping[str, str], *, axes: str = "xyz", start_s: float | None = None) -> Trajectory:
    """Reads markers from a ``.trc``, the table of a motion-capture system that OpenSim takes; metres by the file's own unit.

    Args:
        path: the file.
        keypoints: as for ``from_c3d``.
        axes: as for ``from_c3d``; of OpenSim's files y is up: ``"x-zy"``.
        start_s: time of the file's first image [s]; left out: as the file has it.
    """

    def load(name: str) -> Any:
        # a table of tabs: two lines that say what is in it, then the markers' names, then X1 Y1 Z1 and so on
        lines = Path(name).read_text(encoding="utf-8-sig").splitlines()
        if not lines[0].startswith("PathFileType"):
            raise ValueError("a .trc begins with `PathFileType`")
        said = dict(zip(lines[1].split("\t"), lines[2].split("\t")))
        labels = [cell.strip() for cell in lines[3].split("\t")[2:] if cell.strip()]
        width = 2 + 3 * len(labels)
        rows = [line.split("\t") for line in lines[5:] if line.strip()]
        cells = [[float(cell) if cell.strip() else np.nan for cell in (row + [""] * width)[:width]] for row in rows]
        return labels, said["Units"].strip(), np.array(cells, float).reshape(-1, width)

    labels, unit, table = _read(load, path, {})
    times = table[:, 1] if start_s is None or not len(table) else start_s + table[:, 1] - table[0, 1]
    return _of_markers(path, labels, unit, times, table[:, 2:].reshape(len(table), len(labels), 3), keypoints, axes)


def _of_markers(
    path: str | os.PathLike[str],
    labels: list[str],
    unit: str,
    time_s: Floats,
    position: Floats,
    keypoints: Mapping[str, str],
    axes: str,
) -> Trajectory:
    """Some of a motion-capture system's markers, positions of shape (N, M, 3) in the file's unit and axes."""
    scale = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}.get(unit.lower())
    if scale is None:
        raise InputError(f"{path}: points are in `{unit}`; known are mm, cm and m")
    missing = [marker for marker in keypoints.values() if marker not in labels]
    if missing:
        raise InputError(f"{path} has no marker {missing[0]!r}, but {', '.join(labels)}")
    chosen = position[:, [labels.index(marker) for marker in keypoints.values()]] * scale
    return Trajectory(time_s, list(keypoints), np.stack([sign * chosen[:, :, axis] for axis, sign in _axes(axes)], axis=2))


def _axes(axes: str) -> list[tuple[int, float]]:
    found: list[tuple[int, float]] = []
    sign = 1.0
    for letter in axes:
        if letter in "+-":
            sign = -1.0 if letter == "-" else 1.0
        elif letter in AXES:
            found.append((AXES.index(letter), sign))
            sign = 1.0
        else:
            break
    if sorted(axis for axis, _ in found) != [0, 1, 2]:
        raise InputError(f"axes {axes!r}: wanted are the letters x, y, z once each, in our order, such as `xyz` or `x-zy`")
    return found
