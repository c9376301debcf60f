from math import hypot

import numpy as np

from tjscan.towing.following import PoseFollower, twist_from_velocity, velocity_from_twist
from tjscan.towing.tables import FollowingSettings


def test_a_twist_is_the_velocity_it_was_made_of() -> None:
    velocity = np.array((0.02, -0.03, 0.1))
    np.testing.assert_allclose(
        velocity_from_twist(twist_from_velocity(velocity, 2.1), 2.1), velocity, atol=1e-15
    )


def test_a_vehicle_comes_to_a_pose_that_moves_and_never_beyond_its_top_speed() -> None:
    follower = PoseFollower(FollowingSettings(), top_speed=0.1, top_turn_rate=0.6)
    pose, period, fastest = np.array((0.0, 0.2, 3.0)), 0.1, 0.0
    for k in range(300):
        target = np.array((0.01 * k * period, 0.0, -3.2))
        ahead = target + np.array((0.01 * period, 0, 0))
        twist = follower.follow(pose, target, ahead, period)
        fastest = max(fastest, hypot(twist.speed, twist.sideways))
        pose = pose + period * velocity_from_twist(twist, pose[2] + twist.turn_rate * period / 2)
    assert fastest <= 0.1 + 1e-12
    np.testing.assert_allclose(pose[:2], ahead[:2], atol=2e-4)
    assert abs((pose[2] + 3.2) % (2 * np.pi)) < 1e-3
