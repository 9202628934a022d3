// Reaction of Spot to people during its patrol. The rest of its program is that of any Spot.

// A room with a person in it must not be disinfected: stop the patrol.
@breaks_off
+somebody(Room) : .my_name(Me) <- break_off(a_patrol_room(Me, Room), "person in the room").
