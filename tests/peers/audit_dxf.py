"""Reads DXF files with ezdxf and exits with 1 if its audit finds or repairs anything.

usage: audit_dxf.py FILE...
"""

import sys

import ezdxf


def findings(path):
    try:
        document = ezdxf.readfile(path)
    except (OSError, ezdxf.DXFError) as error:
        return [f"not readable: {error}"]
    auditor = document.audit()
    return [f"{kind}: {entry.message}" for kind, entries in (("error", auditor.errors), ("repair", auditor.fixes)) for entry in entries]


def main(paths):
    if not paths:
        print(__doc__, file=sys.stderr)
        return 2
    clean = True
    for path in paths:
        found = findings(path)
        for finding in found:
            print(f"{path}: {finding}")
        if found:
            clean = False
        else:
            print(f"{path}: clean")
    return 0 if clean else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
