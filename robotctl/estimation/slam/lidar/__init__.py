"""SLAM by lidar: keyframes in a pose graph, links between them, loops that close."""
