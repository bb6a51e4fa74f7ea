// A small client of City3D's link (docs/wire.md) in one header: C++17 and POSIX sockets.
//
//     city3d::City city("127.0.0.1", 9870);
//     city.setup(1, "car", {0.5, 1.793, 0.0}, 0.0);
//     city.subscribe(2);
//     city.start();
//     while (auto poses = city.poses(1.0)) city.trajectory(1, points);
//
// Metres, metres per second and radians of the laboratory's floor; times are the city's clock. A city that is served
// with --key wants the same key here: the bytes of that file, without the spaces and line ends around them.
#pragma once

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <iterator>
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

/// FIPS 180-4.
inline std::string sha256(std::string bytes) {
    static constexpr std::array<std::uint32_t, 64> k = {
        0x428a2f98, 0x71374491, 0xb5c0fbcf, 0xe9b5dba5, 0x3956c25b, 0x59f111f1, 0x923f82a4, 0xab1c5ed5,
        0xd807aa98, 0x12835b01, 0x243185be, 0x550c7dc3, 0x72be5d74, 0x80deb1fe, 0x9bdc06a7, 0xc19bf174,
        0xe49b69c1, 0xefbe4786, 0x0fc19dc6, 0x240ca1cc, 0x2de92c6f, 0x4a7484aa, 0x5cb0a9dc, 0x76f988da,
        0x983e5152, 0xa831c66d, 0xb00327c8, 0xbf597fc7, 0xc6e00bf3, 0xd5a79147, 0x06ca6351, 0x14292967,
        0x27b70a85, 0x2e1b2138, 0x4d2c6dfc, 0x53380d13, 0x650a7354, 0x766a0abb, 0x81c2c92e, 0x92722c85,
        0xa2bfe8a1, 0xa81a664b, 0xc24b8b70, 0xc76c51a3, 0xd192e819, 0xd6990624, 0xf40e3585, 0x106aa070,
        0x19a4c116, 0x1e376c08, 0x2748774c, 0x34b0bcb5, 0x391c0cb3, 0x4ed8aa4a, 0x5b9cca4f, 0x682e6ff3,
        0x748f82ee, 0x78a5636f, 0x84c87814, 0x8cc70208, 0x90befffa, 0xa4506ceb, 0xbef9a3f7, 0xc67178f2};
    std::array<std::uint32_t, 8> state = {0x6a09e667, 0xbb67ae85, 0x3c6ef372, 0xa54ff53a,
                                          0x510e527f, 0x9b05688c, 0x1f83d9ab, 0x5be0cd19};
    const auto turned = [](std::uint32_t x, int by) { return x >> by | x << (32 - by); };
    const std::uint64_t bits = 8 * std::uint64_t{bytes.size()};
    bytes.push_back('\x80');
    while (bytes.size() % 64 != 56) bytes.push_back('\0');
    for (int k8 = 56; k8 >= 0; k8 -= 8) bytes.push_back(static_cast<char>(bits >> k8));
    for (std::size_t at = 0; at < bytes.size(); at += 64) {
        std::array<std::uint32_t, 64> w{};
        for (std::size_t i = 0; i < 64; ++i) {
            if (i < 16) {
                for (std::size_t j = 0; j < 4; ++j) w[i] = w[i] << 8 | static_cast<std::uint8_t>(bytes[at + 4 * i + j]);
                continue;
            }
            const auto a = w[i - 15], b = w[i - 2];
            w[i] = w[i - 16] + (turned(a, 7) ^ turned(a, 18) ^ a >> 3) + w[i - 7] + (turned(b, 17) ^ turned(b, 19) ^ b >> 10);
        }
        auto [a, b, c, d, e, f, g, h] = state;
        for (std::size_t i = 0; i < 64; ++i) {
            const auto t1 = h + (turned(e, 6) ^ turned(e, 11) ^ turned(e, 25)) + ((e & f) ^ (~e & g)) + k[i] + w[i];
            const auto t2 = (turned(a, 2) ^ turned(a, 13) ^ turned(a, 22)) + ((a & b) ^ (a & c) ^ (b & c));
            h = g, g = f, f = e, e = d + t1, d = c, c = b, b = a, a = t1 + t2;
        }
        const std::array<std::uint32_t, 8> more = {a, b, c, d, e, f, g, h};
        for (std::size_t i = 0; i < 8; ++i) state[i] += more[i];
    }
    std::string digest;
    for (const auto word : state)
        for (int by = 24; by >= 0; by -= 8) digest.push_back(static_cast<char>(word >> by));
    return digest;
}

/// RFC 2104, the first half.
inline std::string tag(std::string key, const std::string& bytes) {
    if (key.size() > 64) key = sha256(key);
    key.resize(64, '\0');
    std::string inner = key, outer = key;
    for (char& c : inner) c = static_cast<char>(c ^ 0x36);
    for (char& c : outer) c = static_cast<char>(c ^ 0x5c);
    return sha256(outer + sha256(inner + bytes)).substr(0, 16);
}

/// In a time that does not tell where they differ.
inline bool are_same(const std::string& a, const std::string& b) {
    unsigned differ = a.size() == b.size() ? 0 : 1;
    for (std::size_t i = 0; i < a.size() && i < b.size(); ++i) differ |= static_cast<std::uint8_t>(a[i] ^ b[i]);
    return differ == 0;
}

}  // namespace detail

/// The key that a file holds.
inline std::string key_of(const char* path) {
    std::ifstream file(path, std::ios::binary);
    std::string key{std::istreambuf_iterator<char>(file), {}};
    const auto begin = key.find_first_not_of(" \t\r\n"), end = key.find_last_not_of(" \t\r\n");
    if (begin == std::string::npos) throw std::runtime_error(std::string("no key in ") + path);
    return key.substr(begin, end - begin + 1);
}

/// A city that is served, and the sender that this object is to it.
class City {
public:
    explicit City(const std::string& host = "127.0.0.1", std::uint16_t port = 9870, double patience = 10.0,
                  const std::string& key = "")
        : socket_(::socket(AF_INET, SOCK_DGRAM, 0)), patience_(patience), key_(key) {
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
    static constexpr std::uint8_t version = 2;

    struct Datagram {
        unsigned kind;
        std::string bytes;
    };

    static double now() {
        using namespace std::chrono;
        return duration<double>(steady_clock::now().time_since_epoch()).count();
    }

    /// What is behind a datagram.
    std::string check(const std::string& bytes) const {
        if (!key_.empty()) return detail::tag(key_, bytes);
        detail::Writer out;
        out.number(detail::crc32(bytes));
        return out.bytes;
    }

    void send(unsigned kind, const std::string& body) {
        detail::Writer out;
        out.bytes = "C3DL";
        out.number(version);
        out.number(static_cast<std::uint8_t>(kind));
        out.number(static_cast<std::uint16_t>(key_.empty() ? 0 : 1));
        out.number(session_);
        out.number(challenge_);
        // A Hello that asks for the challenge belongs to no session yet.
        out.number(challenge_ != 0 ? ++sequence_ : std::uint64_t{0});
        out.number(std::uint32_t{0});
        out.bytes += body;
        out.bytes += check(out.bytes);
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
            const ssize_t size = key_.empty() ? 4 : 16;
            if (length < static_cast<ssize_t>(header_bytes) + size) {
                if (length < 0) ::usleep(1000);
                continue;
            }
            Datagram found{static_cast<std::uint8_t>(data[5]), std::string(data, data + length - size)};
            const std::string last(data + length - size, data + length);
            detail::Reader head(found.bytes, 8);
            const auto session = head.number<std::uint64_t>(), peer = head.number<std::uint64_t>();
            const bool is_ours = found.bytes.compare(0, 4, "C3DL") == 0 && found.bytes[4] == version &&
                                 peer == session_ && (city_ == 0 || city_ == session) &&
                                 detail::are_same(last, check(found.bytes));
            if (!is_ours) continue;
            city_ = session;
            return found;
        }
        return std::nullopt;
    }

    /// Answers the city's challenge, which all later datagrams name.
    void hello() {
        const double until = now() + patience_;
        std::random_device random;
        const std::uint64_t nonce = std::uint64_t{random()} << 32 | random();
        detail::Writer body;
        body.number(nonce);
        body.number(std::uint64_t{0});
        while (now() < until) {
            send(1, body.bytes);
            const auto found = receive(now() + 0.2);
            if (!found) continue;
            if (found->kind == 65) return;
            if (found->kind != 70 || challenge_ != 0) continue;
            detail::Reader in(found->bytes, header_bytes);
            if (in.number<std::uint64_t>() == nonce) challenge_ = in.number<std::uint64_t>();
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
    std::string key_;
    std::uint64_t session_ = 0, city_ = 0, challenge_ = 0, sequence_ = 0;
    std::uint32_t request_ = 0;
    std::map<std::uint32_t, std::uint32_t> counts_;
};

}  // namespace city3d
