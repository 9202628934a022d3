"""Waldo: greets people and offers help without being asked."""
