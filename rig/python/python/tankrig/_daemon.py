"""A rig that a daemon serves, over its HTTP interface."""

from __future__ import annotations

import json
import os
import time
import urllib.error
import urllib.parse
import urllib.request
import uuid
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from ._results import Record
from ._run import Run
from .errors import DataError, HardwareError, HeldError, InputError, InternalError, RigError

# How often a job is asked after while somebody waits for it [s]; chosen.
_ASKED_EVERY_S = 0.5
# A request may take so long [s]: the daemon's own limit is 10 s.
_REQUEST_LIMIT_S = 15.0
# Ends of a job, and what is raised for each.
_ENDS: dict[str, type[RigError] | None] = {"done": None, "failed": DataError, "cancelled": DataError, "lost": InternalError}
_STATUS = {401: InputError, 403: InputError, 404: InputError, 409: DataError, 429: DataError, 500: InternalError}


class Daemon:
    """A client of ``rig daemon``.

    Args:
        url: where it serves, such as ``http://127.0.0.1:8071``.
        rig: which of its rigs; may be left out where it has one.
        token: what whoever adds or cancels jobs must show; left out: ``RIG_TOKEN`` of the environment.
        token_file: the file that the daemon says at its start, ``.token`` in the runs folder.
    """

    def __init__(
        self,
        url: str,
        rig: str | None = None,
        *,
        token: str | None = None,
        token_file: str | os.PathLike[str] | None = None,
    ) -> None:
        if not url.startswith(("http://", "https://")):
            raise InputError(f"{url} is no address; wanted is one such as http://127.0.0.1:8071")
        self._base = url.split("#")[0].rstrip("/") + "/api/v1"
        if token is None and token_file is not None:
            try:
                token = Path(token_file).read_text().strip()
            except OSError as error:
                raise InputError(f"reading the token {token_file}: {error.strerror}") from error
        self._token = token or os.environ.get("RIG_TOKEN")
        self.rig = rig or self._only_rig()

    def _only_rig(self) -> str:
        rigs = [rig["name"] for rig in self._ask("/rigs")]
        if len(rigs) != 1:
            raise InputError(f"{self._base} serves {', '.join(rigs) or 'no rig'}; say which with `rig`")
        return str(rigs[0])

    def status(self) -> Record:
        """What the rig does now."""
        rigs = {rig["name"]: rig for rig in self._ask("/rigs")}
        if self.rig not in rigs:
            raise InputError(f"{self._base} has no rig {self.rig!r}, but {', '.join(rigs)}")
        found: Record = rigs[self.rig]
        return found

    def jobs(self) -> list[Job]:
        """Its jobs, as the daemon lists them."""
        return [Job(self, job["id"]) for job in self._ask(f"/rigs/{self._name}/jobs")]

    def job(self, id: int) -> Job:
        """One of its jobs."""
        return Job(self, id)

    def run(self, *, film_only: bool = False, why: str | None = None, priority: int | None = None) -> Job:
        """Adds one experiment to the queue: it moves the rig. With ``film_only`` nothing is extracted or fitted."""
        return self.add({"kind": "run", "film_only": film_only}, why=why, priority=priority)

    def fit(self, runs: Sequence[str], *, holdout: Sequence[str] = (), why: str | None = None) -> Job:
        """Adds a fit of runs, named by their ids."""
        return self.add({"kind": "fit", "runs": list(runs), "holdout": list(holdout)}, why=why)

    def diagnose(self, runs: Sequence[str], *, holdout: Sequence[str] = (), why: str | None = None) -> Job:
        """Adds a diagnosis of runs, named by their ids."""
        return self.add({"kind": "diagnose", "runs": list(runs), "holdout": list(holdout)}, why=why)

    def add(self, work: dict[str, Any], *, why: str | None = None, priority: int | None = None) -> Job:
        """Adds a job; ``work`` as ``/api/v1/openapi.json`` describes it. Sent again after a lost answer, it is one job still."""
        body = {"work": work, "why": why, "priority": priority}
        body = {name: value for name, value in body.items() if value is not None}
        return Job(self, self._ask(f"/rigs/{self._name}/jobs", body)["job"])

    def stop(self, why: str = "from Python", by: str | None = None) -> None:
        """Stops what moves, and holds the rig."""
        self._ask(f"/rigs/{self._name}/stop", {"why": why, **({"by": by} if by else {})})

    @property
    def _name(self) -> str:
        return urllib.parse.quote(self.rig, safe="")

    def _ask(self, path: str, body: dict[str, Any] | None = None) -> Any:
        request = urllib.request.Request(self._base + path)
        if self._token:
            request.add_header("Authorization", f"Bearer {self._token}")
        if body is not None:
            request.data = json.dumps(body).encode()
            request.add_header("Content-Type", "application/json")
            request.add_header("Idempotency-Key", str(uuid.uuid4()))
        what = f"asking {self._base}{path}"
        try:
            with urllib.request.urlopen(request, timeout=_REQUEST_LIMIT_S) as answer:
                text = answer.read()
        except urllib.error.HTTPError as error:
            raise _refusal(what, error, self._token is not None) from error
        except (OSError, urllib.error.URLError) as error:
            raise HardwareError(f"{what}: {getattr(error, 'reason', error)}; is the daemon running with --listen?") from error
        return json.loads(text, object_pairs_hook=Record) if text else Record()

    def __repr__(self) -> str:
        return f"Daemon({self._base.removesuffix('/api/v1')!r}, {self.rig!r})"


def _refusal(what: str, error: urllib.error.HTTPError, has_token: bool) -> RigError:
    try:
        why = json.load(error)["error"]
    except (ValueError, KeyError, TypeError):
        why = error.reason
    hint = "" if error.code != 401 or has_token else "; give `token_file`, which the daemon says at its start"
    return _STATUS.get(error.code, InputError)(f"{what}: {why}{hint}")


class Job:
    """A job in a daemon's queue.

    Attributes:
        id: its number.
    """

    def __init__(self, daemon: Daemon, id: int) -> None:
        self._daemon = daemon
        self.id = id

    @property
    def record(self) -> Record:
        """All that the daemon says of it now."""
        found: Record = self._daemon._ask(f"/rigs/{self._daemon._name}/jobs/{self.id}")
        return found

    @property
    def state(self) -> str:
        """``queued``, ``running``, ``done``, ``failed``, ``cancelled`` or ``lost``."""
        return str(self.record["state"])

    def wait(self, timeout_s: float | None = None, tell: Callable[[Record], object] | None = None) -> Job:
        """Waits until it has ended; Ctrl-C ends the waiting, not the job.

        Args:
            timeout_s: not for longer than that [s].
            tell: called with each new ``record``.

        Raises:
            DataError: where it failed or was cancelled, with what the daemon says.
            HeldError: where the rig is held.
            TimeoutError: where it takes longer than ``timeout_s``.
        """
        ends = None if timeout_s is None else time.monotonic() + timeout_s
        while True:
            record = self.record
            if tell is not None:
                tell(record)
            if record["state"] in _ENDS:
                break
            if ends is not None and time.monotonic() > ends:
                raise TimeoutError(f"job {self.id} is still {record['state']} after {timeout_s} s")
            time.sleep(_ASKED_EVERY_S)
        raised = _ENDS[record["state"]]
        if raised is not None:
            why = record.get("error") or record.get("why") or "no reason is known"
            raise (HeldError if record.get("status") == "held" else raised)(f"job {self.id} is {record['state']}: {why}")
        return self

    def cancel(self, why: str = "from Python") -> None:
        """Cancels it; a servo is stopped first."""
        self._daemon._ask(f"/rigs/{self._daemon._name}/jobs/{self.id}/cancel", {"why": why})

    @property
    def run(self) -> Run:
        """The run folder it made, where that is on this machine."""
        path = self.record.get("run")
        if not path:
            raise DataError(f"job {self.id} has made no run")
        return Run(path)

    def file(self, name: str) -> Any:
        """A JSON file of the run it made, such as ``fit.json``, wherever that is."""
        path = self.record.get("run")
        if not path:
            raise DataError(f"job {self.id} has made no run")
        run = urllib.parse.quote(Path(path).name, safe="")
        return self._daemon._ask(f"/rigs/{self._daemon._name}/runs/{run}/{urllib.parse.quote(name)}")

    def __repr__(self) -> str:
        return f"Job({self.id} of {self._daemon.rig})"
