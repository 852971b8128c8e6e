"""Files of maps, places and worlds.

Public names:

- `map_file.load_map`, `map_file.save_map`: ROS maps
- `world.load_walls`, `localisation_map.load_localisation_map`, `place_file.load_book`: worlds,
  either kind by its name, places
"""
