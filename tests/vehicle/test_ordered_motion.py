"""What may come from orders: anything between them and rest, for as long as they may take."""

from hypothesis import given
from hypothesis import strategies as st

from tjscan.vehicle.ordered_motion import RESPONSE_TIME, OrderedMotion
from tjscan.vehicle.vehicle import AT_REST, Twist

SPEEDS = st.floats(-0.5, 0.5)
TWISTS = st.builds(Twist, SPEEDS, SPEEDS, SPEEDS)


def between(a: Twist, b: Twist, share: float) -> Twist:
    pairs = zip((a.speed, a.turn_rate, a.sideways), (b.speed, b.turn_rate, b.sideways), strict=True)
    return Twist(*((1 - share) * one + share * other for one, other in pairs))


@given(st.lists(TWISTS, min_size=1, max_size=6), st.floats(0, 1), st.data())
def test_a_vehicle_on_its_way_between_orders_is_no_alarm(
    orders: list[Twist], share: float, data: st.DataObject
) -> None:
    ordered = OrderedMotion()
    for n, twist in enumerate(orders):
        ordered.order(twist, 0.1 * n)
    now = max(0.1 * len(orders), RESPONSE_TIME)
    recent = [AT_REST, *orders[-4:]] if len(orders) > 4 else [AT_REST, *orders]
    one, other = data.draw(st.sampled_from(recent)), data.draw(st.sampled_from(recent))
    assert not ordered.contradicts(between(one, other, share), now)


@given(TWISTS, st.sampled_from(["speed", "turn_rate", "sideways"]), st.sampled_from([-1, 1]))
def test_what_is_faster_than_ordered_is_an_alarm(twist: Twist, which: str, sign: int) -> None:
    ordered = OrderedMotion()
    ordered.order(twist, 0.0)
    wanted = {key: getattr(twist, key) for key in ("speed", "turn_rate", "sideways")}
    beyond = wanted | {which: wanted[which] + sign * (abs(wanted[which]) + 0.1)}
    assert ordered.contradicts(Twist(**beyond), 2 * RESPONSE_TIME)


def test_an_order_that_was_taken_back_explains_motion_for_its_response_time_alone() -> None:
    ordered = OrderedMotion()
    ordered.order(Twist(0.3, 0.0), 0.0)
    for n in range(40):
        ordered.order(AT_REST, 1.0 + 0.05 * n)
    moves = Twist(0.2, 0.0)
    assert not OrderedMotion().contradicts(moves, 10.0)  # before the first order nothing is known
    assert ordered.contradicts(moves, 1.0 + 0.05 * 40)
    for late in (0.0, 0.2, 0.5):  # as the two messages together were, and it brakes from 0.3 m/s
        braking = OrderedMotion()
        braking.order(Twist(0.3, 0.0), 0.0)
        braking.order(AT_REST, 1.0)
        assert not braking.contradicts(moves, 1.0 + late + 0.3)
    again = OrderedMotion()
    again.order(Twist(0.3, 0.0), 0.0)
    again.order(AT_REST, 1.0)
    assert not again.contradicts(moves, 1.0 + 0.9 * RESPONSE_TIME)
