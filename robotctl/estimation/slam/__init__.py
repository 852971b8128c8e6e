"""Simultaneous localisation and mapping: one joint estimate of robot and map.

Reading order of SLAM by scans, front to back:

1. `local_scans`: what a scan of each sensor is.
2. `front_end`: surface, score_field, correlative, point_to_line, agreement; two scans compared.
3. `keyframes.mapper`: the pipeline; `SlamMapper.add` names its stages.
4. `keyframes`: robot_state, motion, odometry_trust, prediction; trail, local_map, registration,
   hypotheses, tracker; keyframe, known_places; insertion, linking, straight_walls; loops,
   recognisers, verification; back_end; relocaliser.
5. `incremental`, `factors`, `graph`, `linear`: the smoother behind `keyframes.back_end`.

Constants of `front_end` define the search grid, the noise of points and the kernels compiled with
them; thresholds that a robot may need otherwise are in `estimation.slam_tuning`.
"""

from lazy_loader import attach_stub

__getattr__, __dir__, __all__ = attach_stub(__name__, __file__)
