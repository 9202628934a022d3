"""Receptionist of a doctor's practice, and a telephone that knows who is in."""

from socialbot import Input, Node, Output, Parameter
from socialbot.agents.dialogue import Answer, Respond
from socialbot.agents.reception import CallStatus, ColleagueCall, Receptionist
from socialbot.bdi import variables

Who, _ = variables("Who _")


class PracticeReceptionist(Receptionist):
    """Receptionist that also tells where prescriptions are."""

    def rules(self):
        return [*super().rules(), Respond(Who, "prescription", _) >> [Answer(Who, "prescription", ())]]


class Telephone(Node):
    """Telephone that reaches the colleagues who are in."""

    calls = Input(ColleagueCall, "/reception/calls")
    status = Output(CallStatus, "/reception/call_status")

    present = Parameter("weber", "colleagues who are in, separated by spaces")

    @calls
    def on_call(self, call: ColleagueCall) -> None:
        state = "coming" if call.colleague in self.present.split() else "unavailable"
        self.status.publish(CallStatus(stamp=self.clock.now(), id=call.id, state=state))
