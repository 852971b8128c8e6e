"""Public names of the package; importing one loads its module only."""

from .localisation_map import load_localisation_map as load_localisation_map
from .map_file import load_map as load_map
from .map_file import save_map as save_map
from .place_file import load_book as load_book
from .world import load_walls as load_walls
