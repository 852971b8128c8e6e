"""A wall that comes nearer, one reading in twelve wild: a running median, and smoothing behind it.

python examples/filter_sonar_readings.py
"""

import numpy as np

from robotctl.estimation.ranging.reading_filters import RunningMedian, Smoothing

rng = np.random.default_rng(1)
truth_m = np.linspace(2.5, 1.5, 1000)  # 20 readings a second at 0.02 m/s
raw_m = truth_m + rng.normal(0.0, 0.01, 1000)
wild = rng.random(1000) < 1.0 / 12.0
raw_m[wild] = rng.uniform(0.2, 4.0, wild.sum())

median, smoothing = RunningMedian(sensors=1, window=5), Smoothing(sensors=1, gain=0.4)
calm_m = np.array([median.update(np.array([range_m]))[0] for range_m in raw_m])
smooth_m = np.array([smoothing.update(np.array([range_m]))[0] for range_m in calm_m])
late = median.latency_readings
for name, found_m, readings in (
    ("raw", raw_m, 0.0),
    ("median", calm_m, late),
    ("median, then smoothing", smooth_m, late + smoothing.latency_readings),
):
    rms_m = np.sqrt(np.mean((found_m - truth_m)[50:] ** 2))
    print(f"{name}: off by {rms_m:.3f} m rms, {readings:.1f} readings late")
