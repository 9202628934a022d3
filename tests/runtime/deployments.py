"""Deployments of Waldo, for tests."""

from __future__ import annotations

from pathlib import Path

from socialbot.runtime.deployment import Deployment, parse_deployment

PLACES = """\
machines:
  robot: {address: 10.77.0.1}
  workstation: {address: 10.77.0.2}
nodes:
  camera: robot
  speech: robot
  head: robot
  image_converter: workstation
  person_detector: workstation
  bdi_engine: workstation
  listener: workstation
"""
"""Which node runs where; the addresses are those of the two hosts of the tests of whole systems."""
PAGE = f"""\
graph: waldo
domain: 42
discovery: peers
{PLACES}\
pictures:
  /camera/image_raw:
    transport: jpeg
    quality: 70
    rate_hz: 15
restart: {{times: 3, within_s: 30, first_s: 0.5, longest_s: 4}}
security: {{keys: keys}}
parameters:
  bdi_engine:
    greeting: Hallo
"""


def deployment(*changes: tuple[str, str], folder: Path = Path("/here")) -> Deployment:
    """The deployment of `PAGE` after ``changes`` of its text."""
    page = PAGE
    for old, new in changes:
        assert old in page
        page = page.replace(old, new)
    return parse_deployment(page, where="dir/d.yaml", folder=folder)
