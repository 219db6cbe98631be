"""Models and their motion."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from . import _native
from ._tables import Floats, Trajectory, columns_of, frame, text_of
from .errors import InputError

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Parameter:
    """A number of a model that a fit may turn.

    Attributes:
        value: in SI.
        unit: ``1`` for none.
    """

    name: str
    value: float
    unit: str


@dataclass(frozen=True, eq=False)
class Jacobian:
    """Derivatives of a motion, exact to rounding, along D directions, which stand last.

    Attributes:
        names: what the motion is derived by, length D: parameters, and ``qpos[0]``, ``qvel[0]`` and so on at the start.
        qpos: of the coordinates, shape (N, nq, D), before it (B,) for a batch.
        qvel: of the velocities, shape (N, nv, D), likewise.
        keypoint_m: of the keypoints, shape (N, K, 3, D), likewise.
    """

    names: list[str]
    qpos: Floats
    qvel: Floats
    keypoint_m: Floats


@dataclass(frozen=True, eq=False)
class Motion:
    """A model's motion, or that of B candidates; arrays of a batch have (B,) in front.

    Attributes:
        time_s: [s], shape (N,).
        qpos: coordinates [rad, m], shape (N, nq): a ball is ``w x y z``, a free joint ``x y z w x y z``.
        qvel: velocities [rad/s, m/s], shape (N, nv).
        keypoints: names, length K.
        keypoint_m: where they are, as the camera sees them [m], shape (N, K, 3).
        errors: of a batch, what became of candidates that cannot be moved, by place; their numbers are NaN.
        jacobian: derivatives, where they were asked for.
    """

    time_s: Floats
    qpos: Floats
    qvel: Floats
    keypoints: list[str]
    keypoint_m: Floats
    errors: dict[int, Exception] = field(default_factory=dict)
    jacobian: Jacobian | None = None

    def trajectory(self, candidate: int | None = None) -> Trajectory:
        """The keypoints as a ``trajectory.csv`` has them, of one candidate of a batch."""
        places = self.keypoint_m if self.keypoint_m.ndim == 3 else None
        if candidate is not None and places is None:
            places = self.keypoint_m[candidate]
        if places is None:
            raise InputError(f"a batch of {len(self.qpos)} motions: say of which candidate")
        return Trajectory(self.time_s, self.keypoints, places)

    def pandas(self, candidate: int | None = None) -> pd.DataFrame:
        """The keypoints as a table indexed by ``time_s``, of one candidate of a batch."""
        return frame(self.trajectory(candidate).columns())

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:
        """The coordinates."""
        return np.array(self.qpos, dtype=dtype, copy=copy)

    def __repr__(self) -> str:
        many = f"{len(self.qpos)} motions, " if self.qpos.ndim == 3 else ""
        failed = f", {len(self.errors)} failed" if self.errors else ""
        return f"Motion({many}{len(self.time_s)} instants, {', '.join(self.keypoints)}{failed})"


class Model:
    """A mechanism in its water, from MJCF.

    >>> model = Model.from_mjcf(
    ...     '<mujoco><worldbody><body><joint name="q" axis="0 -1 0"/>'
    ...     '<geom type="sphere" size="0.01" pos="0 0 -0.1"/><site name="P1" pos="0 0 -0.1"/></body></worldbody></mujoco>'
    ... )
    >>> motion = model.rollout([0.1], duration_s=1.0, every_s=0.5)
    >>> motion.qpos.shape, motion.keypoint_m.shape
    ((3, 1), (3, 1, 3))
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._native = _native.Model(path)

    @classmethod
    def from_mjcf(cls, text: str) -> Model:
        """Reads MJCF from its text."""
        return cls._of(_native.Model.from_mjcf(text))

    @classmethod
    def _of(cls, native: _native.Model) -> Model:
        model = cls.__new__(cls)
        model._native = native
        return model

    def to_mjcf(self, comment: str = "") -> str:
        """The model as MJCF text that MuJoCo opens."""
        return self._native.to_mjcf(comment)

    @property
    def name(self) -> str:
        """What the file calls it."""
        return self._native.name

    @property
    def nq(self) -> int:
        """Number of coordinates."""
        return self._native.nq

    @property
    def nv(self) -> int:
        """Number of velocities."""
        return self._native.nv

    @property
    def joints(self) -> list[str]:
        """Names of the joints, in the order of their coordinates."""
        return self._native.joints

    @property
    def actuators(self) -> list[str]:
        """Names of the drives."""
        return self._native.actuators

    @property
    def keypoints(self) -> list[str]:
        """Names of the keypoints, P0 to Pn."""
        return self._native.keypoints

    @property
    def parameters(self) -> dict[str, Parameter]:
        """All numbers that a fit may turn, by name: ``link1/blunt``, ``q2/damping``, ``servo/gain``, ..."""
        return {name: Parameter(name, value, unit) for name, value, unit in self._native.parameters}

    def with_parameters(self, values: Mapping[str, float]) -> Model:
        """The same model with these parameters at these values [SI]."""
        return self._of(self._native.with_parameters([(name, float(value)) for name, value in values.items()]))

    def rollout(
        self,
        qpos: ArrayLike | None = None,
        qvel: ArrayLike | None = None,
        *,
        servo: Any = None,
        params: Mapping[str, ArrayLike] | None = None,
        time_s: ArrayLike | None = None,
        duration_s: float = 10.0,
        every_s: float = 0.01,
        start_s: float = 0.0,
        base: str | os.PathLike[str] | None = None,
        integrator: str | None = None,
        timestep_s: float | None = None,
        accuracy_m: float | None = None,
        hold_command: bool = False,
        prescribed: bool = False,
        jacobian: bool | Sequence[str] = False,
        threads: int | None = None,
    ) -> Motion:
        """Moves the model, or B candidates of it at once, side by side in SIMD lanes and on all threads.

        Steps as MuJoCo does, with the model's own integrator and time step unless told otherwise; with ``accuracy_m`` by our own steps,
        planned once for the first candidate and the same for all. Python's lock is released meanwhile.

        Args:
            qpos: coordinates at the start [rad, m], shape (nq,) or (B, nq); left out: at the model's reference.
            qvel: velocities at the start [rad/s, m/s], shape (nv,) or (B, nv); left out: at rest.
            servo: what the drives are told: a path to a ``servo.csv``, a ``Servo``, or a table (pandas, or columns by name) with ``time_s``
                and ``<actuator>_rad``; straight lines between rows. Left out: no drive has a command.
            params: values of parameters [SI] by name, each a number or shape (B,): a mapping, or a pandas table with a candidate a row.
            time_s: when to sample [s], shape (N,), not falling; left out: every ``every_s`` until ``duration_s``.
            duration_s: how long to simulate [s].
            every_s: time between samples [s].
            start_s: the initial state is held until then [s].
            base: where the base goes, a ``base.csv`` (``time_s,x_m,z_m,angle_rad``); left out, it stands.
            integrator: ``euler``, ``implicitfast`` or ``rk4``.
            timestep_s: time step [s].
            accuracy_m: our own steps, as long as keypoints stay within this of the exact motion [m].
            hold_command: hold the command over each step, as MuJoCo does, instead of sampling it at Runge-Kutta's stages.
            prescribed: joints of position drives follow their commands exactly.
            jacobian: exact derivatives: ``True`` by all of ``params`` and the whole initial state, or names, such as
                ``["link1/blunt", "qpos[0]"]``.
            threads: how many simulate; left out: all cores. The result is the same for any number.

        Returns:
            The motion; its arrays have (B,) in front where an argument had.

        Raises:
            InputError: for what does not fit the model.
            DataError: where a single motion diverges, or no step is exact enough. In a batch that is in ``Motion.errors``.
        """
        sampled = _times(time_s, duration_s, every_s)
        rest_qpos, rest_qvel = self._native.rest()
        states = [_rows("qpos", qpos, rest_qpos, "coordinates"), _rows("qvel", qvel, rest_qvel, "velocities")]
        named = {str(name): np.asarray(params[name], float) for name in params.keys()} if params is not None else {}
        sizes = {"qpos": states[0], "qvel": states[1], **named}
        count, is_batch = _batch(sizes)
        full = [np.ascontiguousarray(np.broadcast_to(array, (count, array.shape[-1]))) for array in states]
        values = np.empty((count, len(named)))
        for column, array in enumerate(named.values()):
            values[:, column] = array
        servo_file, servo_table = _servo(servo)
        directions: list[str] | None = None
        if jacobian is True:
            starts = [f"{which}[{index}]" for which, size in (("qpos", self.nq), ("qvel", self.nv)) for index in range(size)]
            directions = [*named, *starts]
        elif jacobian is not False:
            directions = [str(name) for name in jacobian]
        qpos_out, qvel_out, places, failed, slopes = self._native.rollout(
            full[0],
            full[1],
            list(named),
            values,
            sampled,
            servo_file=servo_file,
            servo_table=servo_table,
            base_file=base,
            start_s=float(start_s),
            integrator=integrator,
            timestep_s=timestep_s,
            accuracy_m=accuracy_m,
            hold_command=hold_command,
            prescribed=prescribed,
            directions=directions,
            threads=threads,
        )
        if failed and not is_batch:
            raise failed[0][1]
        found = [qpos_out, qvel_out, places, *(slopes or ())]
        if not is_batch:
            found = [array[0] for array in found]
        derived = Jacobian(directions, found[3], found[4], found[5]) if directions is not None else None
        return Motion(sampled, found[0], found[1], self.keypoints, found[2], dict(failed), derived)

    def __repr__(self) -> str:
        return f"Model({self.name!r}, {self.nq} coordinates, keypoints {', '.join(self.keypoints)})"


def _times(time_s: ArrayLike | None, duration_s: float, every_s: float) -> Floats:
    if time_s is not None:
        times = np.ascontiguousarray(time_s, np.float64)
        if times.ndim != 1:
            raise InputError(f"time_s has shape {times.shape}; wanted is (N,)")
        return times
    for name, value in (("duration_s", duration_s), ("every_s", every_s)):
        if not (np.isfinite(value) and value > 0.0):
            raise InputError(f"{name} {value} must be finite and above 0")
    # the last sample is at the duration, where that is a whole number of them but for rounding
    return every_s * np.arange(int(duration_s / every_s + 1e-6) + 1, dtype=np.float64)


def _rows(name: str, given: ArrayLike | None, rest: Floats, what: str) -> Floats:
    array = rest if given is None else np.asarray(given, np.float64)
    if array.ndim not in (1, 2) or array.shape[-1] != len(rest):
        raise InputError(f"{name} has shape {array.shape}; the model has {len(rest)} {what}: wanted is ({len(rest)},) or (B, {len(rest)})")
    return array


def _batch(arrays: dict[str, Floats]) -> tuple[int, bool]:
    """How many candidates there are, and whether any argument says so."""
    counts: dict[str, int] = {}
    for name, array in arrays.items():
        single = 1 if name in ("qpos", "qvel") else 0
        if array.ndim > single + 1:
            raise InputError(f"parameter {name} has shape {array.shape}; wanted is a number or (B,)")
        if array.ndim == single + 1:
            counts[name] = array.shape[0]
    sizes = {count for count in counts.values() if count != 1}
    if len(sizes) > 1:
        raise InputError(f"candidates differ in number: {', '.join(f'{name} {count}' for name, count in counts.items())}")
    return (sizes.pop() if sizes else 1), bool(counts)


def _servo(servo: Any) -> tuple[str | os.PathLike[str] | None, str | None]:
    if servo is None or isinstance(servo, (str, os.PathLike)):
        return servo, None
    return None, text_of(columns_of(servo, "servo"))
