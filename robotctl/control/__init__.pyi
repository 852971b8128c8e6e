"""Public names of the package; importing one loads its module only."""

from .identification.identification import fit_first_order as fit_first_order
from .identification.tuning import simc_pi as simc_pi
from .limiter import LimitsConfig as LimitsConfig
from .limiter import TwistLimiter as TwistLimiter
from .pid import Pid as Pid
from .pid import PidConfig as PidConfig
from .pwm import PwmMap as PwmMap
from .servoing import servo as servo
from .steering_law import steer_round as steer_round
from .wall_following import WallFollower as WallFollower
from .wheel_velocity import WheelVelocityEstimator as WheelVelocityEstimator
