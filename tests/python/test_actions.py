"""Vehicles that are driven by arrays of actions."""

import numpy as np
import pytest

import city3d

AT = {name: place for place, name in enumerate(city3d.COLUMNS)}


def front_axles(world) -> np.ndarray:
    states = world.states()
    heading = states[:, AT["heading_rad"]]
    ahead = states[:, AT["front_axle_m"]][:, None] * np.stack([np.cos(heading), np.sin(heading)], 1)
    return states[:, [AT["x_m"], AT["y_m"]]] + ahead


def lane_change(world, row: int, seconds: float, by_m: float) -> np.ndarray:
    """Waypoints of a vehicle that goes on at its speed and moves over to the left, on a straight road."""
    own = world.states()[row]
    heading, speed = own[AT["heading_rad"]], own[AT["speed_mps"]]
    times = np.arange(0.0, seconds, 0.1)
    share = np.clip(times / (0.8 * seconds), 0.0, 1.0)
    along, left = speed * times, by_m * (3 * share**2 - 2 * share**3)
    rate = np.gradient(left, times)
    start = front_axles(world)[row]
    x = start[0] + along * np.cos(heading) - left * np.sin(heading)
    y = start[1] + along * np.sin(heading) + left * np.cos(heading)
    turned = heading + np.arctan2(rate, speed)
    return np.stack([world.time_s + times, x, y, turned, np.hypot(speed, rate)], 1)


def test_a_vehicle_follows_a_trajectory_and_the_others_their_routes():
    world = city3d.World("straight")
    world.step(2.0)
    waypoints = lane_change(world, 0, 6.0, 3.0)
    world.act(world.ids[:1], waypoints[None], "trajectory")
    before = world.states()
    for _ in range(50):
        world.step()
        wanted = [np.interp(world.time_s, waypoints[:, 0], waypoints[:, column]) for column in (1, 2)]
        assert np.hypot(*(front_axles(world)[0] - wanted)) < 0.15
        assert city3d.STATUSES[int(world.states()[0, AT["status"]])] == "driving"
    heading = before[0, AT["heading_rad"]]
    moved = world.states()[:, [AT["x_m"], AT["y_m"]]] - before[:, [AT["x_m"], AT["y_m"]]]
    left = moved @ np.array([-np.sin(heading), np.cos(heading)])
    assert 2.8 < left[0] < 3.2 and abs(left[1]) < 0.1


def test_after_its_trajectory_a_vehicle_stops_and_after_its_release_it_goes_on():
    world = city3d.World("roundabout")
    world.step(1.0)
    row = world.ids.tolist().index(4)
    world.act([4], lane_change(world, row, 2.0, 0.5)[None], "trajectory")
    world.step(7.0)
    assert world.states()[row, AT["speed_mps"]] < 0.1
    assert any(event["kind"] == "link_lost" and event["vehicle"] == 4 for event in world.events())
    world.release(4)
    world.step(5.0)
    assert world.states()[row, AT["speed_mps"]] > 2.0
    assert abs(world.states()[row, AT["lateral_error_m"]]) < 0.2, "it is back on its lane"


def test_trajectories_of_different_lengths_are_padded():
    world = city3d.World("straight")
    world.step(1.0)
    long, short = lane_change(world, 0, 6.0, 1.0), lane_change(world, 1, 3.0, 1.0)
    together = np.full((2, len(long), 5), np.nan)
    together[0], together[1, : len(short)] = long, short
    world.act([1, 2], together, "trajectory")
    alone = city3d.World("straight")
    alone.step(1.0)
    alone.act([1], long[None], "trajectory")
    alone.act([2], short[None], "trajectory")
    for each in (world, alone):
        each.step(5.0)
    assert world.digest == alone.digest


@pytest.mark.parametrize("model", ["raycast", "bicycle"])
def test_an_acceleration_is_that_of_the_vehicle(model):
    world = city3d.World("straight", model=model)
    world.step(2.0)
    for wanted in (1.0, -1.0):
        before = world.states()[0, AT["speed_mps"]]
        world.act([1], [[wanted, 0.0]], "acceleration")
        world.step(1.0)
        assert abs(world.states()[0, AT["speed_mps"]] - before - wanted) < 0.1
    world.act([1], np.array([[-4.0, 0.0]]), "acceleration")
    world.step(5.0)
    assert abs(world.states()[0, AT["speed_mps"]]) < 0.02, "it stands, and does not reverse"
    world.act([1], [[2.0, 0.2]], "acceleration")
    heading = world.states()[0, AT["heading_rad"]]
    world.step(3.0)
    assert world.states()[0, AT["heading_rad"]] > heading + 0.1, "positive is to the left"


def test_along_the_route_the_library_steers():
    driven = []
    for wanted in (None, 3.0, -0.5):
        world = city3d.World("roundabout")
        row, ids = world.ids.tolist().index(4), world.ids
        if wanted is not None:
            world.act([4], [wanted], "along_route")
        world.step(10.0)
        own = world.states()[row]
        assert abs(own[AT["lateral_error_m"]]) < 0.3 and city3d.STATUSES[int(own[AT["status"]])] != "collided"
        driven.append(own[AT["distance_m"]])
    assert driven[1] > driven[0] > driven[2], driven
    least, most = world.limits(ids).T
    assert np.allclose(least, -5.0) and np.allclose(most, 3.0)
    assert np.isnan(world.limits([99])).all()


def test_actions_are_carried_out_all_or_none():
    world, other = city3d.World("roundabout"), city3d.World("roundabout")
    for each in (world, other):
        each.step(1.0)
    wrong = [
        ([1, 99], [[1.0, 0.0, 0.0]] * 2, "pedals", r"row 1 \(vehicle 99\): no vehicle 99"),
        ([1, 2], [[1.0, 0.0, 0.0], [1.0, np.nan, 0.0]], "pedals", r"row 1 \(vehicle 2\): brake is NaN"),
        ([1, 2, 1], [[1.0, 0.0]] * 3, "acceleration", r"row 2 \(vehicle 1\): this vehicle has an earlier row"),
        ([1, 2], [1.0, 1e9], "along_route", r"row 1 \(vehicle 2\): acceleration_mps2 is 1000000000"),
        ([1], [[[0, 0, 0, 0, 1], [0, 0, 0, 0, 1]]], "trajectory", r"row 0 \(vehicle 1\): waypoint 1 .* not later"),
        ([1], [[[0, 0, 0, 0, -1]]], "trajectory", "trajectories go forwards"),
        ([1], [[[np.nan] * 5]], "trajectory", "no waypoint"),
        ([1], [[0, 0, 0, 0, 1]], "trajectory", r"time_s, x_m, y_m, heading_rad, speed_mps"),
    ]
    for ids, actions, kind, message in wrong:
        with pytest.raises(ValueError, match=message):
            world.act(ids, actions, kind)
    for each in (world, other):
        each.step(5.0)
    assert world.digest == other.digest


def test_worlds_with_actions_of_all_kinds_are_restored_to_the_bit():
    world = city3d.World("roundabout", environment="testbed")
    world.step(3.0)
    world.act([2], [[1.0, 0.0]], "acceleration")
    world.act([3], [[0.4, 0.0, 0.01]])
    world.act([5], [-1.0], "along_route")
    world.step(0.53)
    saved, at = world.save(), world.digest
    world.step(1.0)
    later = world.digest
    world.restore(saved)
    assert world.digest == at
    world.step(1.0)
    assert world.digest == later
    straight = city3d.World("straight")
    straight.step(2.0)
    straight.act([1], lane_change(straight, 0, 4.0, 1.0)[None], "trajectory")
    straight.step(1.01)
    saved, at = straight.save(), straight.digest
    straight.restore(saved)
    assert straight.digest == at
