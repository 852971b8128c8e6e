"""Public names of the package; importing one loads its module only."""

from .camera.calibration.homography import fit_homography as fit_homography
from .camera.calibration.intrinsics import calibrate_lens as calibrate_lens
from .camera.ground import GroundCamera as GroundCamera
from .grid.occupancy_grid import OccupancyGrid as OccupancyGrid
from .kalman.ekf import PoseEkf as PoseEkf
from .kalman.ekf_config import EkfConfig as EkfConfig
from .landmarks.ekf import LandmarkEkf as LandmarkEkf
from .mcl.config import MclConfig as MclConfig
from .mcl.localiser import MonteCarloLocaliser as MonteCarloLocaliser
from .odometry.odometry import Odometry as Odometry
from .places.database import PlaceBook as PlaceBook
from .ranging.likelihood_field import LikelihoodField as LikelihoodField
from .ranging.sonar_model import SonarModel as SonarModel
