"""Jobs of short simulated crawls."""

SHORT = """
[vehicle]
id = "crawler-1"
[alignment]
length_mm = 50
longest_mm = 100
offset_mm = 20
offset_sigma_mm = 20
in_view_s = 0.1
return_speed_mm_s = 40
speed_mm_s = 40
[guards]
torch_sigma_mm = 20
[weld]
length_m = 0.03
run_up_mm = 30
procedure = "WPS-1"
[[pass]]
speed_mm_s = 20
[[pass]]
speed_mm_s = 20
weave_mm = 2
weave_period_s = 1
procedure = "WPS-2"
[simulation.vehicle]
start_mm = [-30.0, 1.0]
[simulation.vehicle.slip]
ratio = 0.1
[[simulation.joint.beads]]
level_mm = 6
"""
"""A job of two short passes."""
