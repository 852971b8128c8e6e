"""SLAM by local scans: keyframes in a pose graph, links between them, loops that close."""
