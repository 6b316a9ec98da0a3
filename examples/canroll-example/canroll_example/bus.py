"""A bus: what connects the controller and the vehicle's nodes."""

from canroll.plant_sim.buses.profile import BusProfile

VAN = BusProfile("250k_van", bitrate=250_000, load=0.6, above=0.3, gateway_ms=(1.0, 3.0))
"""250 kbit/s, 60 % loaded, the ECU behind a gateway of 1 to 3 ms each way."""
