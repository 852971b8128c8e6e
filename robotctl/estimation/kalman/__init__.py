"""The extended Kalman filter and its noise."""
