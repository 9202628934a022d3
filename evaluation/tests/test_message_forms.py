from __future__ import annotations

import pytest

from evaluation.message_forms import MESSAGES, measure
from socialbot.bridge.transport import open_transport
from socialbot.core.errors import InstallationError

pytestmark = pytest.mark.ros


def test_measures_each_message_in_both_forms():
    try:
        open_transport(form="typed")
    except InstallationError as error:
        pytest.skip(str(error))
    costs = measure(count=20, rounds=1)
    assert [(cost.message, cost.form) for cost in costs] == [
        (name, form) for name in MESSAGES for form in ("json", "typed")
    ]
    assert all(cost.size > 50 and cost.encode_us > 0.0 and cost.decode_us > 0.0 for cost in costs)
