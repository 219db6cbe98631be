"""``rig`` from Python: models of underwater mechanisms moved thousands at a time, fits, diagnoses, run folders.

>>> import tankrig as rig

* ``rig.Run(path)``: a run folder: trajectory, servo, images, fit, diagnosis, the report in a notebook;
* ``rig.Model("chain.xml").rollout(qpos, servo=table, params=batch)``: how a mechanism moves, with exact derivatives;
* ``rig.fit("experiment.toml")``, ``rig.diagnose(fit)``: coefficients, and what the simulation still gets wrong;
* ``rig.to_movement``, ``rig.from_sleap``, ``from_deeplabcut``, ``from_coco``, ``from_nwb``, ``from_c3d``,
  ``from_trc``, ``from_movement``: other formats;
* ``rig.Daemon(url)``: jobs of a rig.

Units are SI, named at the end of each name as in the files. Errors are those of the command line, by class: ``rig.RigError``.
"""

from ._daemon import Daemon, Job
from ._keypoints import (
    Keypoints,
    from_c3d,
    from_coco,
    from_deeplabcut,
    from_movement,
    from_nwb,
    from_sleap,
    from_trc,
    to_movement,
)
from ._model import Jacobian, Model, Motion, Parameter
from ._native import __version__
from ._results import Diagnosis, Fit, Record, diagnose, fit
from ._run import Run
from ._tables import Images, Servo, Trajectory
from .errors import (
    DataError,
    HardwareError,
    HeldError,
    InputError,
    InternalError,
    Interrupted,
    MissingPackage,
    RigError,
)

__all__ = [
    "Daemon",
    "DataError",
    "Diagnosis",
    "Fit",
    "HardwareError",
    "HeldError",
    "Images",
    "InputError",
    "InternalError",
    "Interrupted",
    "Jacobian",
    "Job",
    "Keypoints",
    "MissingPackage",
    "Model",
    "Motion",
    "Parameter",
    "Record",
    "RigError",
    "Run",
    "Servo",
    "Trajectory",
    "__version__",
    "diagnose",
    "fit",
    "from_c3d",
    "from_coco",
    "from_deeplabcut",
    "from_movement",
    "from_nwb",
    "from_sleap",
    "from_trc",
    "to_movement",
]
