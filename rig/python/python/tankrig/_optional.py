"""Packages that only some of this needs."""

from __future__ import annotations

import importlib
from typing import Any

from .errors import MissingPackage


def needed(module: str, what: str, package: str | None = None) -> Any:
    """The module called ``module``, which ``what`` needs.

    Raises:
        MissingPackage: where it is not installed, with the command that installs it.
    """
    try:
        return importlib.import_module(module)
    except ImportError as error:
        package = package or module.partition(".")[0].replace("_", "-")
        missing = getattr(error, "name", None) or module
        reason = "" if missing.partition(".")[0] == module.partition(".")[0] else f" ({error})"
        raise MissingPackage(f"{what} needs the package {package}{reason}: pip install {package}") from error
