"""Speech synthesis, playback and the queue of utterances."""

from socialbot.core.registry import AgentPackage

AGENT = AgentPackage(
    name="speech",
    module="socialbot.speech",
    nodes={"speaker": "socialbot.speech.speaker:Speaker"},
)
