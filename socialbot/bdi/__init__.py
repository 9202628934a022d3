"""Beliefs, desires and intentions: the engine that decides."""
