"""Rooms rendered by another program, Mitsuba with mitransient: furniture, materials, rooms, and their light over time."""

import mitsuba

mitsuba.set_variant("llvm_ad_mono")
