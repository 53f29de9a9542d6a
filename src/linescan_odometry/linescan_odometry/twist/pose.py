"""Former place of `omni_core.pose`, for imports of earlier releases."""

from omni_core.pose import Pose, PoseIntegrator

__all__ = ["Pose", "PoseIntegrator"]
