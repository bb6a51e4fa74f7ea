// Sets up a car, sends it once around the block between Second Avenue, East Street, Main Boulevard and Centre
// Street of the map ids3c, and tells where it came by.
//
//     g++ -std=c++17 -O2 -o drive_block drive_block.cpp
//     city3d serve roundabout --headless &
//     ./drive_block [PORT [KEY_FILE]]
#include "city3d_link.hpp"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <utility>

namespace {

constexpr double pi = 3.14159265358979323846;
constexpr double speed = 0.2;      // m/s of the laboratory
constexpr double braking = 0.1;    // m/s2, at the end of the way
constexpr double radius = 0.2;     // of the corners
constexpr double start_x = 0.5, start_y = 1.793;
constexpr double front_axle = 0.06;  // ahead of the middle of the outline

struct Piece {
    double x, y, yaw, length, curvature;
};

std::vector<Piece> block() {
    const double corners[4][2] = {{1.974, 1.793}, {1.974, -0.241}, {0.071, -0.241}, {0.071, 1.793}};
    std::vector<Piece> pieces;
    double x = start_x, y = start_y;
    for (int k = 0; k < 4; ++k) {
        const double yaw = -k * pi / 2;
        const double length = std::hypot(corners[k][0] - x, corners[k][1] - y) - radius;
        pieces.push_back({x, y, yaw, length, 0.0});
        x += length * std::cos(yaw);
        y += length * std::sin(yaw);
        pieces.push_back({x, y, yaw, radius * pi / 2, -1 / radius});
        x += radius * (std::cos(yaw) + std::sin(yaw));
        y += radius * (std::sin(yaw) - std::cos(yaw));
    }
    pieces.push_back({x, y, 0.0, start_x - x, 0.0});
    return pieces;
}

city3d::Point at(const std::vector<Piece>& pieces, double s) {
    for (const Piece& p : pieces) {
        if (s > p.length && &p != &pieces.back()) {
            s -= p.length;
            continue;
        }
        const double yaw = p.yaw + p.curvature * s;
        if (p.curvature == 0.0) return {0, p.x + s * std::cos(yaw), p.y + s * std::sin(yaw), yaw, 0};
        return {0, p.x + (std::sin(yaw) - std::sin(p.yaw)) / p.curvature,
                p.y - (std::cos(yaw) - std::cos(p.yaw)) / p.curvature, yaw, 0};
    }
    return {};
}

/// How far along the way, and how fast, the car shall be at a time.
std::pair<double, double> plan(double way, double now) {
    const double braking_s = speed / braking, begin_s = way / speed - braking_s / 2;
    const double late = std::min(std::max(now - begin_s, 0.0), braking_s);
    return {speed * std::min(now, begin_s) + speed * late - braking * late * late / 2, speed - braking * late};
}

}  // namespace

int main(int argc, char** argv) try {
    const auto port = static_cast<std::uint16_t>(argc > 1 ? std::atoi(argv[1]) : 9870);
    city3d::City city("127.0.0.1", port, 10.0, argc > 2 ? city3d::key_of(argv[2]) : "");
    const auto pieces = block();
    double way = 0.0;
    for (const Piece& piece : pieces) way += piece.length;
    city.setup(1, "courier", {start_x - front_axle, start_y, 0.0}, speed, "drive_block");
    city.subscribe(2);
    bool began = false;
    while (const auto poses = city.poses(30.0)) {
        const double now = poses->time;
        std::vector<city3d::Point> points;
        for (int k = 0; k < 13; ++k) {
            const auto [s, speed_there] = plan(way, now + 0.25 * k);
            auto point = at(pieces, s);
            point.time = now + 0.25 * k;
            point.speed = speed_there;
            points.push_back(point);
        }
        city.trajectory(1, points, points[0].speed <= 0.0);
        if (!began) city.start();
        began = true;
        const city3d::Pose& pose = poses->vehicles.at(1);
        const bool is_over = pose.status == city3d::Status::finished || pose.status == city3d::Status::collided;
        if (poses->tick % 100 == 0 || is_over) {
            const char* status = pose.status == city3d::Status::finished   ? "finished"
                                 : pose.status == city3d::Status::collided ? "collided"
                                                                           : "on its way";
            std::printf("{\"t\": %.3f, \"x\": %.4f, \"y\": %.4f, \"status\": \"%s\"}\n", now, pose.x, pose.y, status);
        }
        if (is_over && now > way / speed + 3.0) break;
    }
    city.pause();
} catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
}
