"""Coordinates the six cars of the roundabout: first come, first served, on energy-optimal plans.

    city3d check roundabout-coordinated --json --routes > routes.json
    city3d serve roundabout-coordinated --headless &
    python3 coordinate_roundabout.py routes.json [PORT [KEY_FILE]]

`routes.json` has routes, control zones and conflict intervals (docs/link.md, Routes as data); `-` reads it from standard
input. Laboratory metres and seconds of the city's clock.
"""

import bisect
import json
import math
import sys

from city3d_link import City

STEP = 0.04  # s, of sampled plans
ARRIVAL_STEP = 0.1  # s, between the arrivals that are tried
LATEST = 25.0  # s, the latest arrival that is tried
OPENING = 1.0  # m, on which a car that is too close opens its gap at least
BEYOND = 0.6  # m behind the last conflict on which gaps are kept
PARKING = 0.35  # m, between cars that stand at the end of a lane


class Plan:
    """A motion: positions of the front axle and speeds, STEP apart. It stands at its end."""

    def __init__(self, start, positions, speeds):
        self.start, self.positions, self.speeds = start, positions, speeds

    def at(self, now):
        place = max(now - self.start, 0.0) / STEP
        k = int(place)
        if k + 1 >= len(self.positions):
            return self.positions[-1], 0.0
        share = place - k
        return tuple(a[k] + share * (a[k + 1] - a[k]) for a in (self.positions, self.speeds))

    def time_at(self, position):
        """When the front axle passes a position: long ago if it is behind its start, never if it is beyond its end."""
        k = bisect.bisect_left(self.positions, position)
        if k == 0:
            return self.start if position >= self.positions[0] else -math.inf
        if k == len(self.positions):
            return math.inf
        low, high = self.positions[k - 1], self.positions[k]
        return self.start + STEP * (k - 1 + (position - low) / (high - low))

    def effort(self):
        """The integral of squared acceleration."""
        return sum((b - a) ** 2 for a, b in zip(self.speeds, self.speeds[1:])) / STEP


class Car:
    """A car with its route, and its plan while it has one."""

    def __init__(self, data):
        self.number, self.name, self.start = data["id"], data["name"], data["start"]
        body, driver = data["body"], data["driver"]
        self.length, self.overhang, self.front_axle = body["length_m"], body["overhang_m"], body["front_axle_m"]
        self.strongest, self.hardest = driver["max_acceleration_mps2"], -driver["min_acceleration_mps2"]
        self.standstill = driver["standstill_gap_m"]
        self.points = [tuple(p[key] for key in ("at_m", "x_m", "y_m", "yaw_rad", "speed_mps")) for p in data["points"]]
        self.step = self.points[1][0]
        if len(data["passages"]) != 1:
            sys.exit(f"{self.name} passes {len(data['passages'])} control zones; this program coordinates one")
        [passage] = data["passages"]
        self.entry, (self.first, self.last) = passage["entry_m"], passage["conflicts_m"]
        self.end = self.points[-1][0] - 0.05
        self.plan, self.is_in_zone = None, False
        self.place = self.start["axle_m"]

    def on_route(self, position):
        """Arc length, x, y, yaw and speed profile."""
        place = min(max(position / self.step, 0.0), len(self.points) - 1.001)
        k = int(place)
        return [a + (place - k) * (b - a) for a, b in zip(self.points[k], self.points[k + 1])]

    def limit(self, position):
        place = min(max(position / self.step, 0.0), len(self.points) - 1.001)
        k = int(place)
        low, high = self.points[k][4], self.points[k + 1][4]
        return low + (place - k) * (high - low)

    def measure(self, pose):
        """Finds the front axle along the route: the nearest point to the measured pose."""
        yaw = 2.0 * math.atan2(pose.qz, pose.qw)
        x, y = pose.x + self.front_axle * math.cos(yaw), pose.y + self.front_axle * math.sin(yaw)
        near = [p for p in self.points if abs(p[0] - self.place) < 0.5]
        at, px, py, heading, _ = min(near, key=lambda p: math.hypot(p[1] - x, p[2] - y))
        self.place = at + (x - px) * math.cos(heading) + (y - py) * math.sin(heading)

    def front_at(self, place):
        return self.plan.time_at(place - self.overhang)

    def rear_at(self, place):
        return self.plan.time_at(place + self.length - self.overhang)

    def drive(self, now, position, speed, cap=math.inf, until=math.inf, end=None):
        """Along the speed profile under a cap, with half of u_max and half of u_min, up to a standstill at `end`."""
        end = self.end if end is None else end
        positions, speeds = [position], [speed]
        while position < min(until, end) and len(positions) < 5000:
            stopping = math.sqrt(self.hardest * max(end - position, 0.0))
            wanted = min(cap, self.limit(position + speed * STEP), stopping)
            speed = min(max(wanted, speed - self.hardest * STEP), speed + 0.5 * self.strongest * STEP)
            if speed < 0.002:
                break
            position += speed * STEP
            positions.append(position)
            speeds.append(speed)
        return Plan(now, positions, speeds)

    def cubic(self, now, position, speed, duration):
        """p = p0 + v0 t + b t^2 + a t^3 up to the first conflict, where u = 0; None beyond the bounds."""
        lag = self.first - self.overhang - position - speed * duration
        b, a = 1.5 * lag / duration ** 2, -0.5 * lag / duration ** 3
        leaving = speed + 1.5 * lag / duration
        if not -self.hardest <= 2.0 * b <= self.strongest or leaving < self.least_speed:
            return None
        count = max(round(duration / STEP), 1)
        times = [STEP * k for k in range(count + 1)]
        positions = [position + (speed + (b + a * t) * t) * t for t in times]
        speeds = [speed + (2.0 * b + 3.0 * a * t) * t for t in times]
        for k in range(0, count + 1, 5):
            if speeds[k] > self.limit(positions[k]) + 1e-3:
                return None
        return Plan(now, positions, speeds) if speeds[-1] <= self.limit(positions[-1]) + 1e-3 else None

    def onwards(self, approach):
        """A way up to the first conflict, and along the speed profile behind it."""
        now = approach.start + STEP * (len(approach.positions) - 1)
        rest = self.drive(now, approach.positions[-1], approach.speeds[-1])
        return Plan(approach.start, approach.positions + rest.positions[1:], approach.speeds + rest.speeds[1:])

    def candidates(self, now, position, speed):
        """Ways up to the first conflict, the soonest first."""
        to = self.first - self.overhang
        top = max(p[4] for p in self.points)
        caps = [self.least_speed + (top - self.least_speed) * k / 40 for k in range(41)]
        ways = [self.drive(now, position, speed, cap, until=to) for cap in caps]
        durations = [ARRIVAL_STEP * k for k in range(1, int(LATEST / ARRIVAL_STEP))]
        ways += [self.cubic(now, position, speed, duration) for duration in durations]
        return sorted(filter(None, ways), key=lambda way: way.time_at(to - 1e-3))


class Coordinator:
    """Plans by order of entry: each car keeps the gaps behind all that have entered before."""

    def __init__(self, routes):
        self.rules = routes["coordination"]
        Car.least_speed = self.rules["min_speed_mps"]
        self.cars = {data["id"]: Car(data) for data in routes["vehicles"]}
        self.order = []
        self.conflicts = {}
        for conflict in routes["conflicts"]:
            (one, other), (here, there) = conflict["vehicles"], conflict["intervals_m"]
            self.conflicts.setdefault((one, other), []).append((conflict["kind"], here, there))
            self.conflicts.setdefault((other, one), []).append((conflict["kind"], there, here))

    def enter(self, now):
        """Cars that have reached their control zones get plans; the one that can be first at its conflict goes first."""
        new = [car for car in self.cars.values() if not car.is_in_zone and car.place + car.overhang >= car.entry]
        for car in sorted(new, key=lambda car: car.plan.time_at(car.first - car.overhang)):
            car.is_in_zone = True
            self.order.append(car)
            self.schedule(car, now)

    def schedule(self, car, now):
        """The soonest way that keeps all gaps, and of those about as soon the one with the least effort."""
        position, speed = car.plan.at(now)
        if abs(position - car.place) > self.rules["tolerance_m"]:
            position = car.place
        ahead = self.order[:self.order.index(car)]
        car.end = car.points[-1][0] - 0.05 - PARKING * len(ahead)
        to = car.first - car.overhang
        if position >= to:
            # In its conflicts it keeps its way, from where it is.
            car.plan = car.drive(now, position, speed)
            return
        best, soonest = None, math.inf
        for way in car.candidates(now, position, speed):
            if way.time_at(to - 1e-3) > soonest + 2.0 * ARRIVAL_STEP:
                break
            if best and way.effort() >= best.effort():
                continue
            car.plan = car.onwards(way)
            if all(self.keeps_gaps(car, other, position, speed, now) for other in ahead):
                best, soonest = way, min(soonest, way.time_at(to - 1e-3))
        # Infeasible is a result: it stops before its first conflict.
        car.plan = car.onwards(best) if best else car.drive(now, position, speed, end=max(position, to - 0.05))

    def keeps_gaps(self, car, other, position, speed, now):
        front = position + car.overhang
        gap, opened = self.rules["rear_gap_s"], max(car.first, front + OPENING)
        at_first = min(gap, self.headway(car, other, front, now) / max(speed, 0.05))
        for kind, here, there in self.conflicts[car.number, other.number]:
            if kind == "cross":
                if car.front_at(here[0]) < other.rear_at(there[1]) + self.rules["lateral_gap_s"]:
                    return False
                continue
            offset = here[1] - there[1] if kind == "merge" else here[0] - there[0]
            place = max(here[0], front + 0.1)
            while place < min(here[1], car.last + BEYOND):
                share = min(max((place - front) / (opened - front), 0.0), 1.0)
                least = at_first + (gap - at_first) * share * share
                if car.front_at(place) < other.rear_at(place - offset + car.standstill) + least - 0.01:
                    return False
                place += 0.1
        return True

    def headway(self, car, other, front, now):
        """The distance to a car on the same lane. One that is closer than its gap opens it up to the first conflict."""
        for kind, here, there in self.conflicts[car.number, other.number]:
            rear = other.plan.at(now)[0] + other.overhang - other.length + here[0] - there[0]
            if kind == "lane" and (here[0] <= front < here[1] or here[0] <= rear + other.length < here[1]):
                return rear - car.standstill - front
        return math.inf

    def step(self, poses):
        """Takes measured poses; a car that is off its plan, and all behind it, get others."""
        now = poses.time
        for car in self.cars.values():
            car.measure(poses.vehicles[car.number])
        self.enter(now)
        late = [abs(car.place - car.plan.at(now)[0]) > self.rules["tolerance_m"] for car in self.order]
        if any(late):
            for car in self.order[late.index(True):]:
                self.schedule(car, now)

    def points(self, car, now):
        """Its plan as a trajectory of the link, 3 s long."""
        points = []
        for k in range(13):
            position, speed = car.plan.at(now + 0.25 * k)
            _, x, y, yaw, _ = car.on_route(position)
            points.append((now + 0.25 * k, x, y, yaw, speed))
        return points

    def is_through(self, car):
        return car.place + car.overhang - car.length > car.last


def main():
    if len(sys.argv) < 2 or sys.argv[1].startswith("--"):
        sys.exit(__doc__)
    file = sys.stdin if sys.argv[1] == "-" else open(sys.argv[1])
    line = json.load(file)
    if "routes" not in line:
        sys.exit(f"{sys.argv[1]} has no routes; make it with: city3d check roundabout-coordinated --json --routes")
    if len(sys.argv) > 2 and not sys.argv[2].isdecimal():
        sys.exit(f"{sys.argv[2]} is no port; the city is on this machine")
    port = int(sys.argv[2]) if len(sys.argv) > 2 else 9870
    key = open(sys.argv[3], "rb").read().strip() if len(sys.argv) > 3 else None
    coordinator = Coordinator(line["routes"])
    cars = coordinator.cars.values()
    try:
        city = City(port=port, key=key)
    except TimeoutError as error:
        sys.exit(f"port {port}: {error}; start one with: city3d serve roundabout-coordinated --headless")
    for car in cars:
        at = car.start
        city.setup(car.number, car.name, at["x_m"], at["y_m"], at["yaw_rad"], at["speed_mps"], "coordinate_roundabout")
        car.plan = car.drive(0.0, at["axle_m"], at["speed_mps"])
    coordinator.enter(0.0)
    city.subscribe(every_ticks=4)
    through, began = {}, False
    for poses in city.poses(wait=30.0):
        now = poses.time
        if len(poses.vehicles) < len(cars):
            continue
        coordinator.step(poses)
        for car in cars:
            points = coordinator.points(car, now)
            city.trajectory(car.number, points, finished=points[0][4] <= 0.0)
            if poses.vehicles[car.number].status == "collided":
                sys.exit(f"{car.name} has collided at {now:.2f} s")
            if coordinator.is_through(car) and car.name not in through:
                through[car.name] = now
                print(json.dumps({"name": car.name, "through_s": round(now, 2)}), flush=True)
        if not began:
            city.start()
            began = True
        if len(through) == len(cars):
            break
    city.pause()
    if len(through) < len(cars):
        sys.exit("the city sends no poses any more")


if __name__ == "__main__":
    main()
