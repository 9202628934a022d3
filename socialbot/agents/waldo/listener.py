"""The listener hears what the agent wants to do and tells the actuators."""

from __future__ import annotations

from socialbot.errors import MessageError
from socialbot.graph import Input, Node, Output
from socialbot.messages import ActionRequest, HeadCommand, Utterance


class Listener(Node):
    """``speak`` becomes an utterance and a head that follows people, as ``attend`` does without words.

    ``stayIdle`` becomes a head that looks straight on.
    """

    actions = Input(ActionRequest, "/waldo/actions")
    say = Output(Utterance, "/speech/say")
    head = Output(HeadCommand, "/head/command")

    @actions
    def on_action(self, action: ActionRequest) -> None:
        """Sends the commands for one action. Raises MessageError for an action that no actuator can do."""
        match action.name, action.arguments:
            case "speak", (str(situation), str(text)):
                self._look("track", action)
                self.say.publish(
                    Utterance(stamp=action.stamp, id=f"say-{action.id}", text=text, key=situation, cause=action.id)
                )
            case "attend", ():
                self._look("track", action)
            case "stayIdle", ():
                self._look("centre", action)
            case _:
                raise MessageError(
                    f"no actuator does {action.name}{action.arguments}",
                    where=self.name,
                    remedy="send speak(situation, sentence), attend() or stayIdle()",
                )

    def _look(self, mode: str, action: ActionRequest) -> None:
        self.head.publish(HeadCommand(stamp=action.stamp, mode=mode, cause=action.id))  # type: ignore[arg-type]
