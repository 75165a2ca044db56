"""What no person's motion or shape exceeds, whatever body model it is for."""

from __future__ import annotations

FARTHEST_M = 1000.0
"""A place farther off is no motion's."""
HIGHEST_M = 50.0
"""Above or below the floor, over most of a motion: who is there is in another unit."""
RATES_HZ = 1.0, 10_000.0
"""Of a file. Motion capture runs at 30 to 480 frames a second; a slower "rate" is a duration or a
slip."""
LARGEST_ANGLE_RAD = 100.0
"""Of a joint: sixteen turns. A dancer's spin is often written as an angle that goes on growing."""
LARGEST_BETA = 100.0
"""In standard deviations of people's shapes."""
MOST_FRAMES = 108_000
"""Of a file, and of what is made of it: a quarter of an hour at 120 Hz, half an hour at 60."""
