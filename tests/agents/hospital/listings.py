"""The mission of the paper: who does it, and what they do."""

from __future__ import annotations

SPOT, UVD, NURSE, ROOM = "spotrobot1", "uvdrobot1", "nurse_disinfected1", "room1"
LISTING_3 = [
    ("a_navigate_to", SPOT, ROOM),
    ("a_open_door", SPOT, ROOM),
    ("a_approach_nurse", SPOT, NURSE),
    ("a_authenticate_nurse", SPOT, NURSE),
    ("a_authorize_patrol", SPOT, NURSE),
    ("a_patrol_room", SPOT, ROOM),
    ("a_authorize_disinfect", UVD, SPOT),
    ("a_navigate_to", UVD, ROOM),
    ("a_disinfect_room", UVD, ROOM),
]
"""The mission when all goes well."""
LISTING_4 = [*LISTING_3[:6], ("a_adapt_room", NURSE, ROOM), *LISTING_3[2:]]
"""The mission when the patrol meets a dirty room."""
