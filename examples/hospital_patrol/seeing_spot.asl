// What Spot makes of what it sees on patrol; the rest of its program is that of any Spot.

// Somebody in the room: it is not fit to be disinfected. That needs no further look.
@breaks_off
+somebody(Room) : .my_name(Me) <- break_off(a_patrol_room(Me, Room), "person in the room").
