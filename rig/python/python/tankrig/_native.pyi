"""The compiled half."""

import os
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

__version__: str

_Floats = NDArray[np.float64]
_Path = str | os.PathLike[str]
_Tell = Callable[[str, int, int | None], object] | None

class Model:
    def __new__(cls, path: _Path) -> Model: ...
    @staticmethod
    def from_mjcf(text: str) -> Model: ...
    def to_mjcf(self, comment: str) -> str: ...
    @property
    def name(self) -> str: ...
    @property
    def nq(self) -> int: ...
    @property
    def nv(self) -> int: ...
    @property
    def joints(self) -> list[str]: ...
    @property
    def actuators(self) -> list[str]: ...
    @property
    def keypoints(self) -> list[str]: ...
    @property
    def parameters(self) -> list[tuple[str, float, str]]: ...
    def with_parameters(self, values: list[tuple[str, float]]) -> Model: ...
    def rest(self) -> tuple[_Floats, _Floats]: ...
    def rollout(
        self,
        qpos: _Floats,
        qvel: _Floats,
        names: list[str],
        values: _Floats,
        time_s: _Floats,
        *,
        servo_file: _Path | None,
        servo_table: str | None,
        base_file: _Path | None,
        start_s: float,
        integrator: str | None,
        timestep_s: float | None,
        accuracy_m: float | None,
        hold_command: bool,
        prescribed: bool,
        directions: list[str] | None,
        threads: int | None,
    ) -> tuple[_Floats, _Floats, _Floats, list[tuple[int, Exception]], tuple[_Floats, _Floats, _Floats] | None]: ...

def fit(
    experiment: _Path,
    out: _Path,
    *,
    threads: int | None = None,
    resume: bool = False,
    profile: bool = False,
    prior: _Path | None = None,
    tell: _Tell = None,
) -> list[str]: ...
def diagnose(
    experiment: _Path, out: _Path, *, threads: int | None = None, config: _Path | None = None, tell: _Tell = None
) -> list[str]: ...
def import_keypoints(
    file: _Path,
    config: _Path,
    out: _Path,
    *,
    model: _Path | None = None,
    keypoints: str | None = None,
    individual: str | None = None,
    fps: float | None = None,
    times: _Path | None = None,
    least_likelihood: float = 0.6,
    std_px: float | None = None,
) -> list[str]: ...
def read_trajectory(path: _Path) -> tuple[_Floats, list[str], _Floats, _Floats | None]: ...
def read_command(path: _Path) -> tuple[list[str], _Floats, _Floats]: ...
def read_pictures(path: _Path, sequences: set[int]) -> list[tuple[str, NDArray[np.uint8] | str]]: ...
