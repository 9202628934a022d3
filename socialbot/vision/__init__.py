"""Cameras, image conversion, person detection, tracking and distance."""

from socialbot.core.registry import AgentPackage

AGENT = AgentPackage(
    name="vision",
    module="socialbot.vision",
    nodes={
        "camera": "socialbot.vision.camera_node:Camera",
        "image_converter": "socialbot.vision.images:ImageConverter",
        "person_detector": "socialbot.vision.person_detector:PersonDetector",
        "picture_receiver": "socialbot.vision.image_transport:ImageReceiver",
        "picture_sender": "socialbot.vision.image_transport:ImageSender",
    },
)
