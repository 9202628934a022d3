"""Speech and hearing: synthesis, playback, the queue of utterances, microphone and recognition."""

from socialbot.core.registry import AgentPackage

AGENT = AgentPackage(
    name="speech",
    module="socialbot.speech",
    nodes={
        "hearing": "socialbot.speech.hearing:Hearing",
        "microphone": "socialbot.speech.microphone:Microphone",
        "speaker": "socialbot.speech.speaker:Speaker",
    },
    messages=("socialbot.speech.messages:MESSAGES",),
)
