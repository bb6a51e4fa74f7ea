// Coordinates the six cars of the roundabout: first come, first served, on energy-optimal plans.
//
//     g++ -std=c++17 -O2 -o coordinate_roundabout coordinate_roundabout.cpp
//     city3d check roundabout-coordinated --json --routes > routes.json
//     city3d serve roundabout-coordinated --headless &
//     ./coordinate_roundabout routes.json [PORT [KEYFILE]]
//
// routes.json has routes, control zones and conflict intervals (docs/link.md, Routes as data). Laboratory metres and
// seconds of the city's clock.
#include "city3d_json.hpp"
#include "city3d_link.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <iterator>
#include <limits>

namespace {

using city3d::Json;

constexpr double never = std::numeric_limits<double>::infinity();
constexpr double step_s = 0.04;          // of sampled plans
constexpr double arrival_step_s = 0.1;   // between the arrivals that are tried
constexpr double latest_s = 25.0;        // the latest arrival that is tried
constexpr double opening_m = 1.0;        // on which a car that is too close opens its gap at least
constexpr double beyond_m = 0.6;         // behind the last conflict on which gaps are kept
constexpr double parking_m = 0.35;       // between cars that stand at the end of a lane

struct State {
    double position, speed;
};

/// A motion of the front axle, sampled. It stands at its end.
struct Plan {
    double start = 0.0;
    std::vector<State> states;

    State at(double now) const {
        const double place = std::max(now - start, 0.0) / step_s;
        const auto k = static_cast<std::size_t>(place);
        if (k + 1 >= states.size()) return {states.back().position, 0.0};
        const double share = place - static_cast<double>(k);
        const State &a = states[k], &b = states[k + 1];
        return {a.position + share * (b.position - a.position), a.speed + share * (b.speed - a.speed)};
    }
    /// Long ago for a place behind its start, never for one beyond its end.
    double time_at(double position) const {
        if (position < states.front().position) return -never;
        const auto found = std::lower_bound(states.begin(), states.end(), position,
                                            [](const State& state, double at) { return state.position < at; });
        if (found == states.begin()) return start;
        if (found == states.end()) return never;
        const State &low = found[-1], &high = *found;
        const auto k = static_cast<double>(found - states.begin() - 1);
        return start + step_s * (k + (position - low.position) / (high.position - low.position));
    }
    /// The integral of squared acceleration.
    double effort() const {
        double sum = 0.0;
        for (std::size_t k = 1; k < states.size(); ++k) sum += std::pow(states[k].speed - states[k - 1].speed, 2);
        return sum / step_s;
    }
};

struct Place {
    double at, x, y, yaw, speed;
};

struct Car {
    std::uint32_t id;
    std::string name;
    city3d::Start start;
    double start_speed, length, overhang, front_axle, strongest, hardest, standstill, entry, first, last, end, place;
    std::vector<Place> points;
    Plan plan;
    bool is_in_zone = false;

    explicit Car(const Json& data) : id(static_cast<std::uint32_t>(data["id"].number)), name(data["name"].text) {
        const Json &at = data["start"], &body = data["body"], &driver = data["driver"];
        start = {at["x_m"].number, at["y_m"].number, at["yaw_rad"].number};
        start_speed = at["speed_mps"].number, place = at["axle_m"].number;
        length = body["length_m"].number, overhang = body["overhang_m"].number;
        front_axle = body["front_axle_m"].number, strongest = driver["max_acceleration_mps2"].number;
        hardest = -driver["min_acceleration_mps2"].number, standstill = driver["standstill_gap_m"].number;
        const std::size_t passages = data["passages"].items.size();
        if (passages != 1)
            throw std::runtime_error(name + " passes " + std::to_string(passages) +
                                     " control zones; this program coordinates one");
        const Json& passage = data["passages"][0];
        entry = passage["entry_m"].number;
        first = passage["conflicts_m"][0].number, last = passage["conflicts_m"][1].number;
        for (const Json& p : data["points"].items)
            points.push_back({p["at_m"].number, p["x_m"].number, p["y_m"].number, p["yaw_rad"].number,
                              p["speed_mps"].number});
        end = points.back().at - 0.05;
    }

    Place on_route(double position) const {
        const double step = points[1].at;
        const double index = std::clamp(position / step, 0.0, static_cast<double>(points.size()) - 1.001);
        const auto k = static_cast<std::size_t>(index);
        const double share = index - static_cast<double>(k);
        const Place &a = points[k], &b = points[k + 1];
        const auto mixed = [share](double low, double high) { return low + share * (high - low); };
        return {mixed(a.at, b.at), mixed(a.x, b.x), mixed(a.y, b.y), mixed(a.yaw, b.yaw), mixed(a.speed, b.speed)};
    }
    /// Where the front axle is along the route: the nearest point to the measured pose.
    void measure(const city3d::Pose& pose) {
        const double yaw = 2.0 * std::atan2(pose.qz, pose.qw);
        const double x = pose.x + front_axle * std::cos(yaw), y = pose.y + front_axle * std::sin(yaw);
        const Place* best = nullptr;
        for (const Place& p : points)
            if (std::abs(p.at - place) < 0.5 &&
                (best == nullptr || std::hypot(p.x - x, p.y - y) < std::hypot(best->x - x, best->y - y)))
                best = &p;
        if (best) place = best->at + (x - best->x) * std::cos(best->yaw) + (y - best->y) * std::sin(best->yaw);
    }
    double to_first() const { return first - overhang; }
    double front_at(double where) const { return plan.time_at(where - overhang); }
    double rear_at(double where) const { return plan.time_at(where + length - overhang); }

    /// Along the speed profile under a cap, with half of u_max and half of u_min, up to a standstill.
    Plan drive(double now, State state, double cap, double until, double standing) const {
        Plan plan{now, {state}};
        while (state.position < std::min(until, standing) && plan.states.size() < 5000) {
            const double stopping = std::sqrt(hardest * std::max(standing - state.position, 0.0));
            const double limit = on_route(state.position + state.speed * step_s).speed;
            const double wanted = std::max(std::min({cap, limit, stopping}), state.speed - hardest * step_s);
            state.speed = std::min(wanted, state.speed + 0.5 * strongest * step_s);
            if (state.speed < 0.002) break;
            state.position += state.speed * step_s;
            plan.states.push_back(state);
        }
        return plan;
    }
    /// p = p0 + v0 t + b t^2 + a t^3 up to the first conflict, where u = 0; empty beyond the bounds.
    Plan cubic(double now, State from, double duration, double least_speed) const {
        const double lag = to_first() - from.position - from.speed * duration;
        const double b = 1.5 * lag / (duration * duration), a = -0.5 * lag / std::pow(duration, 3);
        const bool is_within = 2.0 * b >= -hardest && 2.0 * b <= strongest;
        if (!is_within || from.speed + 1.5 * lag / duration < least_speed) return {};
        Plan plan{now, {}};
        const int count = std::max(static_cast<int>(std::lround(duration / step_s)), 1);
        for (int k = 0; k <= count; ++k) {
            const double t = step_s * k;
            const State state{from.position + (from.speed + (b + a * t) * t) * t,
                              from.speed + (2.0 * b + 3.0 * a * t) * t};
            if (state.speed > on_route(state.position).speed + 1e-3) return {};
            plan.states.push_back(state);
        }
        return plan;
    }
    /// A way up to the first conflict, and along the speed profile behind it.
    Plan onwards(Plan approach) const {
        const Plan rest = drive(0.0, approach.states.back(), never, never, end);
        approach.states.insert(approach.states.end(), rest.states.begin() + 1, rest.states.end());
        return approach;
    }
    /// Ways up to the first conflict, the soonest first.
    std::vector<Plan> candidates(double now, State from, double least_speed) const {
        double top = 0.0;
        for (const Place& p : points) top = std::max(top, p.speed);
        std::vector<Plan> ways;
        for (int k = 0; k <= 40; ++k)
            ways.push_back(drive(now, from, least_speed + (top - least_speed) * k / 40, to_first(), end));
        for (double duration = arrival_step_s; duration < latest_s; duration += arrival_step_s)
            if (Plan way = cubic(now, from, duration, least_speed); !way.states.empty()) ways.push_back(way);
        std::stable_sort(ways.begin(), ways.end(),
                         [this](const Plan& a, const Plan& b) { return arrival(a) < arrival(b); });
        return ways;
    }
    double arrival(const Plan& way) const { return way.time_at(to_first() - 1e-3); }
    bool is_through() const { return place + overhang - length > last; }
};

struct Conflict {
    std::string kind;
    double from, to, other_from, other_to;
};

/// Plans by order of entry: each car keeps the gaps behind all that have entered before.
class Coordinator {
public:
    std::vector<Car> cars;

    explicit Coordinator(const Json& routes)
        : lateral_gap_(routes["coordination"]["lateral_gap_s"].number),
          rear_gap_(routes["coordination"]["rear_gap_s"].number),
          least_speed_(routes["coordination"]["min_speed_mps"].number),
          tolerance_(routes["coordination"]["tolerance_m"].number) {
        for (const Json& data : routes["vehicles"].items) cars.emplace_back(data);
        for (const Json& found : routes["conflicts"].items) {
            const auto one = static_cast<std::uint32_t>(found["vehicles"][0].number);
            const auto other = static_cast<std::uint32_t>(found["vehicles"][1].number);
            const Json &here = found["intervals_m"][0], &there = found["intervals_m"][1];
            const double a[2] = {here[0].number, here[1].number}, b[2] = {there[0].number, there[1].number};
            conflicts_[{one, other}].push_back({found["kind"].text, a[0], a[1], b[0], b[1]});
            conflicts_[{other, one}].push_back({found["kind"].text, b[0], b[1], a[0], a[1]});
        }
        for (Car& car : cars) car.plan = car.drive(0.0, {car.place, car.start_speed}, never, never, car.end);
    }

    /// Cars that have reached their control zones get plans; the one that can be first at its conflict goes first.
    void enter(double now) {
        std::vector<Car*> entering;
        for (Car& car : cars)
            if (!car.is_in_zone && car.place + car.overhang >= car.entry) entering.push_back(&car);
        std::stable_sort(entering.begin(), entering.end(),
                         [](const Car* a, const Car* b) { return a->front_at(a->first) < b->front_at(b->first); });
        for (Car* car : entering) {
            car->is_in_zone = true;
            order_.push_back(car);
            schedule(order_.size() - 1, now);
        }
    }
    /// Takes measured poses; a car that is off its plan, and all behind it, get others.
    void step(const city3d::Poses& poses) {
        for (Car& car : cars) car.measure(poses.vehicles.at(car.id));
        enter(poses.time);
        const auto is_late = [&](const Car* car) {
            return std::abs(car->place - car->plan.at(poses.time).position) > tolerance_;
        };
        const auto late = std::find_if(order_.begin(), order_.end(), is_late);
        for (auto index = late - order_.begin(); index < order_.end() - order_.begin(); ++index)
            schedule(static_cast<std::size_t>(index), poses.time);
    }

private:
    /// The soonest way that keeps all gaps, and of those about as soon the one with the least effort.
    void schedule(std::size_t index, double now) {
        Car& car = *order_[index];
        State from = car.plan.at(now);
        if (std::abs(from.position - car.place) > tolerance_) from.position = car.place;
        car.end = car.points.back().at - 0.05 - parking_m * static_cast<double>(index);
        if (from.position >= car.to_first()) {
            // In its conflicts it keeps its way, from where it is.
            car.plan = car.drive(now, from, never, never, car.end);
            return;
        }
        Plan best;
        double soonest = never;
        for (const Plan& way : car.candidates(now, from, least_speed_)) {
            if (car.arrival(way) > soonest + 2.0 * arrival_step_s) break;
            if (!best.states.empty() && way.effort() >= best.effort()) continue;
            car.plan = car.onwards(way);
            const auto keeps = [&](const Car* other) { return keeps_gaps(car, *other, from, now); };
            if (!std::all_of(order_.begin(), order_.begin() + static_cast<std::ptrdiff_t>(index), keeps)) continue;
            best = way;
            soonest = std::min(soonest, car.arrival(way));
        }
        // Infeasible is a result: it stops before its first conflict.
        const double standing = std::max(from.position, car.to_first() - 0.05);
        car.plan = best.states.empty() ? car.drive(now, from, never, never, standing) : car.onwards(best);
    }
    /// The distance to a car on the same lane. One that is closer than its gap opens it up to the first conflict.
    double headway(const Car& car, const Car& other, double front, double now) {
        for (const Conflict& c : conflicts_[{car.id, other.id}]) {
            const double rear = other.plan.at(now).position + other.overhang - other.length + c.from - c.other_from;
            const auto is_on = [&c](double place) { return c.from <= place && place < c.to; };
            if (c.kind == "lane" && (is_on(front) || is_on(rear + other.length))) return rear - car.standstill - front;
        }
        return never;
    }
    bool keeps_gaps(const Car& car, const Car& other, State from, double now) {
        const double front = from.position + car.overhang, opened = std::max(car.first, front + opening_m);
        const double now_s = headway(car, other, front, now) / std::max(from.speed, 0.05);
        const double at_first = std::min(rear_gap_, now_s);
        for (const Conflict& c : conflicts_[{car.id, other.id}]) {
            if (c.kind == "cross") {
                if (car.front_at(c.from) < other.rear_at(c.other_to) + lateral_gap_) return false;
                continue;
            }
            const double offset = c.kind == "merge" ? c.to - c.other_to : c.from - c.other_from;
            for (double place = std::max(c.from, front + 0.1); place < std::min(c.to, car.last + beyond_m);
                 place += 0.1) {
                const double share = std::clamp((place - front) / (opened - front), 0.0, 1.0);
                const double least = at_first + (rear_gap_ - at_first) * share * share;
                if (car.front_at(place) < other.rear_at(place - offset + car.standstill) + least - 0.01) return false;
            }
        }
        return true;
    }

    double lateral_gap_, rear_gap_, least_speed_, tolerance_;
    std::vector<Car*> order_;
    std::map<std::pair<std::uint32_t, std::uint32_t>, std::vector<Conflict>> conflicts_;
};

/// The plan of a car as a trajectory of the link, 3 s long.
std::vector<city3d::Point> trajectory(const Car& car, double now) {
    std::vector<city3d::Point> points;
    for (int k = 0; k < 13; ++k) {
        const double time = now + 0.25 * k;
        const State state = car.plan.at(time);
        const Place place = car.on_route(state.position);
        points.push_back({time, place.x, place.y, place.yaw, state.speed});
    }
    return points;
}

}  // namespace

int main(int argc, char** argv) try {
    if (argc < 2) throw std::runtime_error("usage: coordinate_roundabout routes.json [PORT [KEYFILE]]");
    std::ifstream file(argv[1], std::ios::binary);
    if (!file) throw std::runtime_error(std::string("cannot read ") + argv[1]);
    Coordinator coordinator(Json::parse({std::istreambuf_iterator<char>(file), {}})["routes"]);
    auto& cars = coordinator.cars;
    const auto port = static_cast<std::uint16_t>(argc > 2 ? std::atoi(argv[2]) : 9870);
    city3d::City city("127.0.0.1", port, 10.0, argc > 3 ? city3d::key_of(argv[3]) : "");
    for (const Car& car : cars) city.setup(car.id, car.name, car.start, car.start_speed, "coordinate_roundabout");
    coordinator.enter(0.0);
    city.subscribe(4);
    std::map<std::string, double> through;
    bool began = false;
    while (through.size() < cars.size()) {
        const auto poses = city.poses(30.0);
        if (!poses) throw std::runtime_error("the city sends no poses any more");
        if (poses->vehicles.size() < cars.size()) continue;
        coordinator.step(*poses);
        for (const Car& car : cars) {
            const auto points = trajectory(car, poses->time);
            city.trajectory(car.id, points, points[0].speed <= 0.0);
            if (poses->vehicles.at(car.id).status == city3d::Status::collided)
                throw std::runtime_error(car.name + " has collided");
            if (!car.is_through() || !through.emplace(car.name, poses->time).second) continue;
            std::printf("{\"name\": \"%s\", \"through_s\": %.2f}\n", car.name.c_str(), poses->time);
            std::fflush(stdout);
        }
        if (!began) city.start();
        began = true;
    }
    city.pause();
} catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
}
