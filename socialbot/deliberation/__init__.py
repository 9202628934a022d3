"""Deliberation on the engine: desires with deadlines, a scheduler that chooses, plans that are carried out."""

from socialbot.bdi.trace import SENTENCES

SENTENCES.update(
    desire="it desired {}",
    desire_refused="it did not desire {}{reason:: }",
    desire_fulfilled="its desire {} was fulfilled",
    desire_dropped="it dropped its desire {}{reason:: }",
    planning="it planned for {}{message:: }",
    plan_start="it began plan {plan} for {}",
    plan_end="plan {plan} for {} was over, {outcome}{reason:: }",
    step="it began the step {}",
    step_end="the step {} was over, {outcome}{message:: }",
    hold="it began nothing new for {}{reason:: }",
    release="it went on with {}",
    rule="its rule {} fired{effect:: }",
    request="{}",
    reply="the answer came from {}{reason:: }",
    asked="{}",
    refused="it refused {}{reason:: }",
    silent="the sensor {} was silent",
    heard="the sensor {} was back",
)
