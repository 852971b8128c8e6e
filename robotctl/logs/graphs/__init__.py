"""Files of factor graphs: g2o, TORO and GTSAM's text."""
