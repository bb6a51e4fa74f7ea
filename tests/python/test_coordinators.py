"""Classes of Python as coordination algorithms."""

import city3d
import pytest


def digest(algorithm: str, duration_s: float = 40.0, **options) -> str:
    world = city3d.World("roundabout-coordinated", set={"coordination.algorithm": algorithm}, **options)
    world.step(duration_s)
    return world.digest


class FirstComeFirstServed:
    def schedule(self, view):
        for request in sorted(view.requests, key=lambda request: (request.entered_s, request.earliest_s, request.vehicle)):
            view.grant(request.vehicle, fills_gaps=False)


class Replanning:
    """The library's `replan`, in Python."""

    def schedule(self, view):
        old = [view.revoke(vehicle) for vehicle in view.replannable()]
        requests = sorted(view.requests, key=lambda request: (request.earliest_s, request.vehicle))
        plans = {request.vehicle: view.grant(request.vehicle) for request in requests}
        if None not in plans.values() and sum(plans[plan.vehicle].exit_s for plan in old) <= sum(plan.exit_s for plan in old):
            return
        for vehicle, plan in plans.items():
            if plan is not None:
                view.revoke(vehicle)
        for plan in old:
            view.restore(plan)
        for request in sorted(view.requests, key=lambda request: (request.entered_s, request.earliest_s, request.vehicle)):
            view.grant(request.vehicle)


class MajorFirst:
    def schedule(self, view):
        def order(request):
            return (request.rank, request.entered_s, request.earliest_s, request.vehicle)

        for request in sorted(view.requests, key=order):
            view.grant(request.vehicle)


@pytest.mark.parametrize(("name", "own"), [("fifo", FirstComeFirstServed), ("replan", Replanning), ("priority", MajorFirst)])
def test_an_algorithm_in_python_does_what_the_same_one_of_the_library_does(name, own):
    assert digest("own", coordinators={"own": own}) == digest(name)


def test_another_order_is_another_run_and_plans_say_when():
    granted = []

    class LastComeFirstServed:
        def schedule(self, view):
            for request in reversed(view.requests):
                plan = view.grant(request.vehicle, not_before_s=request.earliest_s + 1.0)
                if plan is not None:
                    granted.append((request, plan))

    assert digest("own", coordinators={"own": LastComeFirstServed}) != digest("fifo")
    assert granted
    for request, plan in granted:
        assert plan.vehicle == request.vehicle and request.distance_m > 0.0 and request.speed_mps > 0.0
        assert request.earliest_s + 0.99 <= plan.entry_s < plan.exit_s and plan.cost >= 0.0


def test_what_a_coordinator_raises_is_raised_by_the_step_and_its_view_is_over():
    views = []

    class Lost:
        def schedule(self, view):
            views.append(view)
            raise LookupError("no order")

    with pytest.raises(LookupError, match="no order"):
        digest("own", coordinators={"own": Lost})
    with pytest.raises(RuntimeError, match="the view is over"):
        views[0].grant(1)


@pytest.mark.parametrize(
    ("ask", "message"),
    [
        (lambda view: view.grant(99), "vehicle 99 asks for no plan here"),
        (lambda view: view.revoke(99), "vehicle 99 has no plan here"),
        (lambda view: view.grant(view.requests[0].vehicle, not_before_s=float("nan")), "NaN"),
        (lambda view: [view.restore(view.grant(view.requests[0].vehicle)) for _ in range(2)], "was revoked in this call"),
    ],
)
def test_what_a_coordinator_asks_for_wrongly_is_told(ask, message):
    class Wrong:
        def schedule(self, view):
            ask(view)

    with pytest.raises(ValueError, match=message):
        digest("own", 5.0, coordinators={"own": Wrong})


def test_a_coordinator_that_cannot_be_made_or_is_unknown_is_told():
    class Refused:
        def __init__(self):
            raise LookupError("not today")

    with pytest.raises(LookupError, match="not today"):
        digest("own", coordinators={"own": Refused})
    with pytest.raises(ValueError, match="there is no coordination algorithm|algorithm"):
        digest("own", coordinators={"owner": Refused})


def test_a_coordinator_may_be_due_although_nobody_asks():
    calls = []

    class Clockwork(FirstComeFirstServed):
        def is_due(self, now_s):
            return now_s < 5.0

        def schedule(self, view):
            calls.append(view.now_s)
            super().schedule(view)

    digest("own", 10.0, coordinators={"own": Clockwork})
    assert sum(now_s < 5.0 for now_s in calls) >= 200, "it is asked in each control step"
