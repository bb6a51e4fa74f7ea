// A small client of City3D's link (docs/wire.md) in one header: C++17 and POSIX sockets. It has no shared key.
//
//     city3d::City city("127.0.0.1", 9870);
//     city.setup(1, "car", {0.5, 1.793, 0.0}, 0.0);
//     city.subscribe(2);
//     city.start();
//     while (auto poses = city.poses(1.0)) city.trajectory(1, points);
//
// Metres, metres per second and radians of the laboratory's floor; times are the city's clock.
#pragma once

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#include <chrono>
#include <cstdint>
#include <cstring>
#include <map>
#include <optional>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

namespace city3d {

static_assert(sizeof(double) == 8, "IEEE 754 double precision is needed");

enum class Status : std::uint8_t {
    waiting, driving, yielding, stopped, manual, link_lost, collided, finished, physical, unseen
};

struct Pose {
    Status status;
    double x, y, z, qx, qy, qz, qw;
};

/// All vehicles at one tick.
struct Poses {
    std::uint64_t tick = 0;
    double time = 0.0;
    std::map<std::uint32_t, Pose> vehicles;
};

/// Where the front axle shall be at a time of the city's clock.
struct Point {
    double time, x, y, yaw, speed;
};

struct Start {
    double x, y, yaw;
};

namespace detail {

/// Little-endian, whatever this machine is.
class Writer {
public:
    std::string bytes;

    template <class T> void number(T value) {
        static_assert(std::is_unsigned_v<T>, "whole numbers are unsigned");
        for (unsigned k = 0; k < sizeof(T); ++k) bytes.push_back(static_cast<char>(value >> (8 * k)));
    }
    void real(double value) {
        std::uint64_t word;
        std::memcpy(&word, &value, 8);
        number(word);
    }
    void text(const std::string& text) {
        number(static_cast<std::uint8_t>(text.size()));
        bytes += text;
    }
};

class Reader {
public:
    Reader(const std::string& bytes, std::size_t at) : bytes_(bytes), at_(at) {}

    template <class T> T number() {
        T value = 0;
        if (at_ + sizeof(T) > bytes_.size()) throw std::out_of_range("a datagram ends early");
        for (unsigned k = 0; k < sizeof(T); ++k)
            value |= static_cast<T>(static_cast<T>(static_cast<std::uint8_t>(bytes_[at_++])) << (8 * k));
        return value;
    }
    double real() {
        const auto word = number<std::uint64_t>();
        double value;
        std::memcpy(&value, &word, 8);
        return value;
    }
    std::string text() {
        const auto length = number<std::uint8_t>();
        at_ += length;
        return bytes_.substr(at_ - length, length);
    }

private:
    const std::string& bytes_;
    std::size_t at_;
};

inline std::uint32_t crc32(const std::string& bytes) {
    std::uint32_t crc = 0xffffffffu;
    for (const char c : bytes) {
        crc ^= static_cast<std::uint8_t>(c);
        for (int k = 0; k < 8; ++k) crc = (crc >> 1) ^ (crc & 1 ? 0xedb88320u : 0u);
    }
    return ~crc;
}

}  // namespace detail

/// A city that is served, and the sender that this object is to it.
class City {
public:
    explicit City(const std::string& host = "127.0.0.1", std::uint16_t port = 9870, double patience = 10.0)
        : socket_(::socket(AF_INET, SOCK_DGRAM, 0)), patience_(patience) {
        sockaddr_in address{};
        address.sin_family = AF_INET;
        address.sin_port = htons(port);
        if (socket_ < 0 || inet_pton(AF_INET, host.c_str(), &address.sin_addr) != 1 ||
            ::connect(socket_, reinterpret_cast<sockaddr*>(&address), sizeof address) != 0)
            throw std::runtime_error("no socket to " + host);
        std::random_device random;
        session_ = (std::uint64_t{random()} << 32 | random()) | 1;
        hello();
    }
    ~City() { ::close(socket_); }
    City(const City&) = delete;
    City& operator=(const City&) = delete;

    /// Brings a vehicle in, the middle of its outline at `at`; gives what the city has to say of it.
    std::string setup(std::uint32_t id, const std::string& name, Start at, double speed,
                      const std::string& algorithm = "", const std::string& vehicle_type = "default") {
        detail::Writer out;
        out.number(id);
        out.number(std::uint16_t{0});
        for (const unsigned part : {28u, 79u, 140u}) out.number(static_cast<std::uint8_t>(part));
        for (const double value : {at.x, at.y, at.yaw, speed}) out.real(value);
        out.text(name);
        out.text(algorithm);
        out.number(std::uint8_t{0});
        out.number(std::uint8_t{0});
        out.text(vehicle_type);
        return ask(2, out.bytes);
    }

    /// Up to 28 points, and longer than the vehicle needs to stop.
    void trajectory(std::uint32_t id, const std::vector<Point>& points, bool finished = false) {
        detail::Writer out;
        out.number(std::uint32_t{1});
        out.number(id);
        out.number(++counts_[id]);
        out.number(static_cast<std::uint8_t>(finished ? 2 : 0));
        out.number(std::uint8_t{0});
        out.number(static_cast<std::uint8_t>(points.size()));
        out.number(std::uint8_t{0});
        for (const Point& p : points)
            for (const double value : {p.time, p.x, p.y, p.yaw, p.speed}) out.real(value);
        send(3, out.bytes);
    }

    void start() { ask(5, std::string(1, '\0')); }
    void pause() { ask(5, std::string(1, '\1')); }

    void subscribe(std::uint16_t every_ticks = 1, double lease = 60.0) {
        detail::Writer out;
        out.number(every_ticks);
        out.real(lease);
        ask(6, out.bytes);
    }

    /// The poses of the next tick that come, waiting no longer than so many seconds.
    std::optional<Poses> poses(double wait) {
        const auto until = now() + wait;
        Poses gathered;
        std::map<unsigned, bool> parts;
        while (auto found = receive(until)) {
            if (found->kind != 67) continue;
            detail::Reader in(found->bytes, header_bytes);
            const auto tick = in.number<std::uint64_t>();
            if (tick != gathered.tick) {
                gathered = {};
                parts.clear();
            }
            gathered.tick = tick;
            gathered.time = in.real();
            in.number<std::uint64_t>();
            in.number<std::uint8_t>();
            const auto part = in.number<std::uint8_t>(), count = in.number<std::uint8_t>();
            for (unsigned left = in.number<std::uint8_t>(); left > 0; --left) {
                const auto id = in.number<std::uint32_t>();
                Pose pose{};
                pose.status = static_cast<Status>(in.number<std::uint32_t>() & 0xff);
                for (double* value : {&pose.x, &pose.y, &pose.z, &pose.qx, &pose.qy, &pose.qz, &pose.qw})
                    *value = in.real();
                gathered.vehicles[id] = pose;
            }
            parts[part] = true;
            if (parts.size() == count) return gathered;
        }
        return std::nullopt;
    }

private:
    static constexpr std::size_t header_bytes = 36;

    struct Datagram {
        unsigned kind;
        std::string bytes;
    };

    static double now() {
        using namespace std::chrono;
        return duration<double>(steady_clock::now().time_since_epoch()).count();
    }

    void send(unsigned kind, const std::string& body) {
        detail::Writer out;
        out.bytes = "C3DL";
        out.number(std::uint8_t{1});
        out.number(static_cast<std::uint8_t>(kind));
        out.number(std::uint16_t{0});
        out.number(session_);
        out.number(peer_);
        out.number(++sequence_);
        out.number(std::uint32_t{0});
        out.bytes += body;
        out.number(detail::crc32(out.bytes));
        // One that is lost on its way is asked for again, or followed by the next.
        (void)::send(socket_, out.bytes.data(), out.bytes.size(), 0);
    }

    std::optional<Datagram> receive(double until) {
        for (double left = until - now(); left > 0.0; left = until - now()) {
            timeval wait{};
            wait.tv_sec = static_cast<time_t>(left);
            wait.tv_usec = static_cast<suseconds_t>((left - static_cast<double>(wait.tv_sec)) * 1e6) + 1;
            ::setsockopt(socket_, SOL_SOCKET, SO_RCVTIMEO, &wait, sizeof wait);
            char data[1201];
            const ssize_t length = ::recv(socket_, data, sizeof data, 0);
            if (length < static_cast<ssize_t>(header_bytes + 4)) {
                if (length < 0) ::usleep(1000);
                continue;
            }
            Datagram found{static_cast<std::uint8_t>(data[5]), std::string(data, data + length - 4)};
            const std::string check(data + length - 4, data + length);
            detail::Reader head(found.bytes, 8);
            const auto session = head.number<std::uint64_t>(), peer = head.number<std::uint64_t>();
            const bool is_ours = found.bytes.compare(0, 5, std::string("C3DL\1", 5)) == 0 && peer == session_ &&
                                 (peer_ == 0 || peer_ == session) &&
                                 detail::Reader(check, 0).number<std::uint32_t>() == detail::crc32(found.bytes);
            if (!is_ours) continue;
            peer_ = session;
            return found;
        }
        return std::nullopt;
    }

    void hello() {
        const double until = now() + patience_;
        while (now() < until) {
            send(1, std::string(8, '\0'));
            const auto found = receive(now() + 0.2);
            if (found && found->kind == 65) return;
        }
        throw std::runtime_error("no city answers there");
    }

    /// Sends a request until it is answered.
    std::string ask(unsigned kind, const std::string& body) {
        detail::Writer out;
        out.number(++request_);
        const double until = now() + patience_;
        while (now() < until) {
            send(kind, out.bytes + body);
            const double again = now() + 0.1;
            while (const auto found = receive(again)) {
                if (found->kind != 66) continue;
                detail::Reader in(found->bytes, header_bytes);
                if (in.number<std::uint32_t>() != request_) continue;
                const auto outcome = in.number<std::uint8_t>();
                in.number<std::uint64_t>();
                if (outcome == 2) throw std::runtime_error("refused: " + in.text());
                if (outcome == 0) return in.text();
            }
        }
        throw std::runtime_error("the city does not answer, or another sender leads it");
    }

    int socket_;
    double patience_;
    std::uint64_t session_ = 0, peer_ = 0, sequence_ = 0;
    std::uint32_t request_ = 0;
    std::map<std::uint32_t, std::uint32_t> counts_;
};

}  // namespace city3d
