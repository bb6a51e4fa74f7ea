// A small reader of JSON (RFC 8259) for what City3D prints, in one header: C++17. Escapes in texts stay as they are.
#pragma once

#include <cstdlib>
#include <cstring>
#include <map>
#include <stdexcept>
#include <string>
#include <vector>

namespace city3d {

/// A value: a number, a text, or what has others in it.
struct Json {
    double number = 0.0;
    std::string text;
    std::vector<Json> items;
    std::map<std::string, Json> fields;

    const Json& operator[](const std::string& name) const {
        const auto found = fields.find(name);
        if (found == fields.end()) throw std::runtime_error("the JSON has no field \"" + name + "\"");
        return found->second;
    }
    const Json& operator[](std::size_t index) const { return items.at(index); }

    static Json parse(const std::string& text) {
        const char* at = text.c_str();
        return value(at, 0);
    }

private:
    static char next(const char*& at) {
        while (*at != '\0' && std::strchr(" \t\r\n", *at)) ++at;
        return *at;
    }
    static void expect(const char*& at, char wanted) {
        if (next(at) != wanted) throw std::runtime_error(std::string("not JSON: no ") + wanted + " where one belongs");
        ++at;
    }
    static std::string quoted(const char*& at) {
        expect(at, '"');
        std::string text;
        while (*at != '"' && *at != '\0') {
            if (*at == '\\' && at[1] != '\0') text += *at++;
            text += *at++;
        }
        expect(at, '"');
        return text;
    }
    static bool goes_on(const char*& at, char end) {
        if (next(at) == ',') return ++at, true;
        return expect(at, end), false;
    }
    static Json value(const char*& at, int depth) {
        if (depth > 32) throw std::runtime_error("not JSON of City3D: too deep");
        Json found;
        const char first = next(at);
        if (first == '{' || first == '[') {
            const char end = first == '{' ? '}' : ']';
            ++at;
            if (next(at) == end) return ++at, found;
            do {
                if (first == '[') {
                    found.items.push_back(value(at, depth + 1));
                    continue;
                }
                std::string name = quoted(at);
                expect(at, ':');
                found.fields[name] = value(at, depth + 1);
            } while (goes_on(at, end));
        } else if (first == '"') {
            found.text = quoted(at);
        } else if (std::strncmp(at, "true", 4) == 0 || std::strncmp(at, "null", 4) == 0) {
            found.number = *at == 't' ? 1.0 : 0.0;
            at += 4;
        } else if (std::strncmp(at, "false", 5) == 0) {
            at += 5;
        } else {
            char* end = nullptr;
            found.number = std::strtod(at, &end);
            if (end == at) throw std::runtime_error("not JSON: a value is missing");
            at = end;
        }
        return found;
    }
};

}  // namespace city3d
