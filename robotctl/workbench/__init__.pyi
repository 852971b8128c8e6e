"""Public names of the package; importing one loads its module only."""

from .localise.mapping import make_map as make_map
from .logs.export import export_csv as export_csv
from .odometry.calibrate_odometry import calibrate_odometry as calibrate_odometry
from .planning.options import PlanOptions as PlanOptions
from .planning.plan import make_plan as make_plan
from .sensors.characterise import characterise as characterise
from .tuning.tune import tune as tune
