"""From text to sound: synthesis, playing, a queue of utterances."""
