"""Types that viewers and other packages of ROS know, and the ROS wheels lack: their fields, for bags."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

PACKAGES = ("foxglove_msgs", "tf2_msgs")

DEFINITIONS: Mapping[str, str] = MappingProxyType(
    {
        "foxglove_msgs/msg/Point2": "float64 x\nfloat64 y\n",
        "foxglove_msgs/msg/Color": "float64 r\nfloat64 g\nfloat64 b\nfloat64 a\n",
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
""",
        "foxglove_msgs/msg/CircleAnnotation": """
builtin_interfaces/Time timestamp
foxglove_msgs/Point2 position
float64 diameter
float64 thickness
foxglove_msgs/Color fill_color
foxglove_msgs/Color outline_color
""",
        "foxglove_msgs/msg/TextAnnotation": """
builtin_interfaces/Time timestamp
foxglove_msgs/Point2 position
string text
float64 font_size
foxglove_msgs/Color text_color
foxglove_msgs/Color background_color
""",
        "foxglove_msgs/msg/ImageAnnotations": """
foxglove_msgs/CircleAnnotation[] circles
foxglove_msgs/PointsAnnotation[] points
foxglove_msgs/TextAnnotation[] texts
""",
        "tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms\n",
    }
)
"""The text of the definition of each type, by its name."""
