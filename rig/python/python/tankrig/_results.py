"""Fits and diagnoses: the files of a result folder as objects."""

from __future__ import annotations

import html
import json
import os
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from . import _native
from ._model import Model
from ._optional import needed
from .errors import DataError, InputError, Interrupted

if TYPE_CHECKING:
    import pandas as pd

Progress = bool | Callable[[str, int, "int | None"], object] | None
R = TypeVar("R", bound="Result")


class Record(dict[str, Any]):
    """A JSON object whose members are attributes too."""

    def __getattr__(self, name: str) -> Any:
        try:
            return self[name]
        except KeyError:
            raise AttributeError(f"no `{name}` in it, but {', '.join(self)}") from None

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self]


def record_at(path: Path, made_by: str) -> Record:
    """The JSON object in a file.

    Raises:
        DataError: where there is no such file.
        InputError: where it cannot be read.
    """
    try:
        found = json.loads(path.read_text(), object_pairs_hook=Record)
    except FileNotFoundError:
        raise DataError(f"{path} is not there; {made_by} writes it") from None
    except (OSError, ValueError) as error:
        raise InputError(f"reading {path}: {error}") from error
    if not isinstance(found, Record):
        raise InputError(f"reading {path}: wanted is an object")
    return found


def shown_page(report: Path) -> str | None:
    """A report as a notebook shows it: a page of its own within the page; ``None`` where there is none."""
    try:
        page = report.read_text()
    except OSError:
        return None
    return f'<iframe srcdoc="{html.escape(page)}" style="width:100%;height:40em;border:1px solid #ccc"></iframe>'


class Result:
    """What a fit or a diagnosis left in its folder.

    Attributes:
        folder: the folder, with ``model.xml`` and ``report.html`` beside the result's own file.
        experiment: the experiment it was made of; ``None`` where only the folder is known.
        warnings: what was less than it should have been, a sentence each.
        json: all of the result's file.
    """

    _FILE = ""
    _MADE_BY = ""

    def __init__(self, folder: Path, experiment: Path | None = None, warnings: list[str] | None = None, keep: Any = None) -> None:
        self.folder = folder
        self.experiment = experiment
        self.warnings = warnings or []
        self.json = record_at(folder / self._FILE, self._MADE_BY)
        # a folder of ours lives as long as its result
        self._keep = keep

    @classmethod
    def read(cls: type[R], folder: str | os.PathLike[str]) -> R:
        """Reads the result in a folder: of ``rig fit``, ``rig diagnose``, or a run's."""
        return cls(Path(folder))

    @property
    def model(self) -> Model:
        """The calibrated model."""
        return Model(self.folder / "model.xml")

    @property
    def report(self) -> Path:
        """The report, a page for a browser."""
        return self.folder / "report.html"

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_") or "json" not in self.__dict__:
            raise AttributeError(name)
        return getattr(self.json, name)

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self.json]

    def _repr_html_(self) -> str:
        return shown_page(self.report) or f"<pre>{html.escape(repr(self))}</pre>"


class Fit(Result):
    """Coefficients, as ``fit.json`` has them: each of its members is an attribute.

    Attributes:
        parameters: records with ``name``, ``value``, ``std`` [SI], ``lower``, ``upper``, ``at_bound``, ``determined``.
        loss_m2: mean over images of the sum over keypoints of squared distances [m2].
        noise_m: the keypoints' noise, one sigma [m].
        runs: records with ``id``, ``use``, ``keypoints`` (each ``name``, ``mean_error_m``, ``rms_error_m``).
        unidentifiable: groups of names of which only a combination is seen.
    """

    _FILE = "fit.json"
    _MADE_BY = "`rig fit`"
    parameters: list[Record]
    runs: list[Record]
    loss_m2: float
    noise_m: float
    method: str
    seed: int
    evaluations: int
    stop_reason: str
    unidentifiable: list[list[str]]

    def pandas(self) -> pd.DataFrame:
        """The parameters as a table, a row each."""
        table: pd.DataFrame = needed("pandas", "a table of parameters").DataFrame(self.json.parameters).set_index("name")
        return table

    def __repr__(self) -> str:
        lines = [f"{p.name} = {p.value:.4g}" + (f" +- {p.std:.2g}" if p.determined else " (left open)") for p in self.json.parameters]
        return f"Fit of {self.folder}: {self.json.loss_m2 ** 0.5 * 1e3:.3f} mm rms\n  " + "\n  ".join(lines)


class Diagnosis(Result):
    """What a simulation gets wrong and why, as ``diagnosis.json`` has it: each of its members is an attribute.

    Attributes:
        verdict: ``nothing-detectable``, ``cause``, ``causes``, ``ambiguous`` or ``unexplained``.
        sentence: the same in words.
        causes: records with ``name``, ``aliases``, ``parameters`` (each ``name``, ``value``, ``ci95``, ``unit``), ``delta_bic``, ``probability``.
        alternatives: other sets of causes that would do.
        next_experiments: what to do next, the best first.
        complete: whether the search came to its end.
    """

    _FILE = "diagnosis.json"
    _MADE_BY = "`rig diagnose`"
    verdict: str
    sentence: str
    causes: list[Record]
    alternatives: list[Record]
    next_experiments: list[Record]
    complete: bool

    def __repr__(self) -> str:
        names = ", ".join(cause.name for cause in self.json.causes)
        return f"Diagnosis: {self.json.verdict}{': ' + names if names else ''}. {self.json.get('sentence', '')}"


def fit(
    experiment: str | os.PathLike[str],
    out: str | os.PathLike[str] | None = None,
    *,
    threads: int | None = None,
    resume: bool = False,
    profile: bool = False,
    prior: str | os.PathLike[str] | None = None,
    progress: Progress = None,
) -> Fit:
    """Fits the model of an experiment to its runs, as ``rig fit`` does.

    Args:
        experiment: an ``experiment.toml``, or one run folder.
        out: folder for the results; left out: one that is gone with the fit.
        threads: how many simulate; left out: all cores. The result is the same for any number.
        resume: go on from where an interrupted fit into the same folder stood.
        profile: 95 % intervals from the profile of the likelihood.
        prior: ``fit.json`` of an earlier fit of the same mechanism, to be updated with these runs.
        progress: a line on standard error where somebody looks at it (left out), always or never; or a function of what is being done, how
            much is done, and of how much (``None`` where nobody knows).

    Raises:
        InputError: where the experiment contradicts itself.
        DataError: where its runs hold no answer, or contradict ``prior``.
        Interrupted: on Ctrl-C; the best so far is its ``best``.
    """

    def work(folder: Path, tell: Any) -> list[str]:
        earlier = None if prior is None else os.fspath(prior)
        return _native.fit(experiment, folder, threads=threads, resume=resume, profile=profile, prior=earlier, tell=tell)

    return _made(Fit, Path(experiment), out, progress, work)


def diagnose(
    of: Fit | str | os.PathLike[str],
    out: str | os.PathLike[str] | None = None,
    *,
    threads: int | None = None,
    config: str | os.PathLike[str] | None = None,
    progress: Progress = None,
) -> Diagnosis:
    """Says what a simulation gets wrong and why, as ``rig diagnose`` does.

    Args:
        of: a fit, whose experiment is meant; or an ``experiment.toml``, or one run folder.
        out: folder for the results; left out: one that is gone with the diagnosis.
        threads: how many simulate; left out: all cores.
        config: the rig's config, for those of the runs to make next.
        progress: as for ``fit``.

    Raises:
        InputError: where the experiment contradicts itself.
        DataError: where its runs hold no answer.
        Interrupted: on Ctrl-C; the best so far is its ``best``.
    """
    if isinstance(of, Fit):
        if of.experiment is None:
            raise InputError(f"{of.folder} does not say which experiment it is a fit of; give the experiment.toml or the run folder")
        experiment = of.experiment
    else:
        experiment = Path(of)

    def work(folder: Path, tell: Any) -> list[str]:
        return _native.diagnose(experiment, folder, threads=threads, config=config, tell=tell)

    return _made(Diagnosis, experiment, out, progress, work)


def _made(
    kind: type[R],
    experiment: Path,
    out: str | os.PathLike[str] | None,
    progress: Progress,
    work: Callable[[Path, Any], list[str]],
) -> R:
    keep = tempfile.TemporaryDirectory(prefix="tankrig-") if out is None else None
    folder = Path(keep.name if keep is not None else out)  # type: ignore[arg-type]
    old = _stamp(folder / kind._FILE)
    line = _Line() if _is_shown(progress) else None
    tell: Any = progress if callable(progress) else line
    try:
        warnings = work(folder, tell)
    except KeyboardInterrupt as interrupt:
        new = _stamp(folder / kind._FILE)
        best = kind(folder, experiment, [], keep) if new not in (None, old) else None
        where = f"; {folder} holds the best so far" if best is not None and keep is None else ""
        raise Interrupted(f"interrupted{where}", best) from interrupt
    finally:
        if line is not None:
            line.end()
    return kind(folder, experiment, warnings, keep)


def _stamp(path: Path) -> int | None:
    try:
        return path.stat().st_mtime_ns
    except OSError:
        return None


def _is_shown(progress: Progress) -> bool:
    if progress is None:
        return sys.stderr is not None and (sys.stderr.isatty() or "ipykernel" in sys.modules)
    return progress is True


class _Line:
    """One line on standard error that says how the work goes."""

    _WIDTH = 30

    def __init__(self) -> None:
        self._longest = 0

    def __call__(self, text: str, done: int, of: int | None) -> None:
        if of:
            full = min(self._WIDTH, self._WIDTH * done // of)
            text = f"{text:<40} {'#' * full}{'.' * (self._WIDTH - full)} {done}/{of}"
        self._longest = max(self._longest, len(text))
        print(f"\r{text:<{self._longest}}", end="", file=sys.stderr, flush=True)

    def end(self) -> None:
        if self._longest:
            print(f"\r{'':<{self._longest}}\r", end="", file=sys.stderr, flush=True)
