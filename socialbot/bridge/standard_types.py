"""Types that viewers and other packages of ROS know, and the ROS wheels lack: their fields, for bags."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

PACKAGES = ("foxglove_msgs", "hri_msgs", "tf2_msgs", "vision_msgs")

DEFINITIONS: Mapping[str, str] = MappingProxyType(
    {
        "foxglove_msgs/msg/Point2": "float64 x\nfloat64 y\n",
        "foxglove_msgs/msg/Color": "float64 r\nfloat64 g\nfloat64 b\nfloat64 a\n",
        "foxglove_msgs/msg/KeyValuePair": "string key\nstring value\n",
        "foxglove_msgs/msg/PointsAnnotation": """
builtin_interfaces/Time timestamp
uint8 UNKNOWN=0
uint8 POINTS=1
uint8 LINE_LOOP=2
uint8 LINE_STRIP=3
uint8 LINE_LIST=4
uint8 type
foxglove_msgs/Point2[] points
foxglove_msgs/Color outline_color
foxglove_msgs/Color[] outline_colors
foxglove_msgs/Color fill_color
float64 thickness
foxglove_msgs/KeyValuePair[] metadata
""",
        "foxglove_msgs/msg/CircleAnnotation": """
builtin_interfaces/Time timestamp
foxglove_msgs/Point2 position
float64 diameter
float64 thickness
foxglove_msgs/Color fill_color
foxglove_msgs/Color outline_color
foxglove_msgs/KeyValuePair[] metadata
""",
        "foxglove_msgs/msg/TextAnnotation": """
builtin_interfaces/Time timestamp
foxglove_msgs/Point2 position
string text
float64 font_size
foxglove_msgs/Color text_color
foxglove_msgs/Color background_color
foxglove_msgs/KeyValuePair[] metadata
""",
        "foxglove_msgs/msg/ImageAnnotations": """
builtin_interfaces/Time timestamp
foxglove_msgs/CircleAnnotation[] circles
foxglove_msgs/PointsAnnotation[] points
foxglove_msgs/TextAnnotation[] texts
foxglove_msgs/KeyValuePair[] metadata
""",
        "tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms\n",
        "vision_msgs/msg/Point2D": "float64 x\nfloat64 y\n",
        "vision_msgs/msg/Pose2D": "vision_msgs/Point2D position\nfloat64 theta\n",
        "vision_msgs/msg/BoundingBox2D": "vision_msgs/Pose2D center\nfloat64 size_x\nfloat64 size_y\n",
        "vision_msgs/msg/ObjectHypothesis": "string class_id\nfloat64 score\n",
        "vision_msgs/msg/ObjectHypothesisWithPose": """
vision_msgs/ObjectHypothesis hypothesis
geometry_msgs/PoseWithCovariance pose
""",
        "vision_msgs/msg/Detection2D": """
std_msgs/Header header
vision_msgs/ObjectHypothesisWithPose[] results
vision_msgs/BoundingBox2D bbox
string id
""",
        "vision_msgs/msg/Detection2DArray": "std_msgs/Header header\nvision_msgs/Detection2D[] detections\n",
        "hri_msgs/msg/IdsList": "std_msgs/Header header\nstring[] ids\n",
        "hri_msgs/msg/NormalizedRegionOfInterest2D": """
std_msgs/Header header
float32 xmin
float32 ymin
float32 xmax
float32 ymax
float32 c
""",
    }
)
"""The text of the definition of each type, by its name."""
