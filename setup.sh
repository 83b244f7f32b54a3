#!/bin/sh
# Makes .venv and installs unshade into it, with the extras named in $1 ("" or "test").
# Versions are those of the lock file where Python and platform are those that it was made for, and LOCKED=no is
# not set; elsewhere the newest that pyproject.toml allows.
# System libraries that open3d and mitsuba link to are installed when this runs as root on Debian, otherwise named.
set -eu
extras="${1:-}"
python="${PYTHON:-python3}"

command -v "$python" >/dev/null || { echo "setup: $python was not found; install Python 3.10 or newer." >&2; exit 2; }
"$python" -c 'import sys; sys.exit(sys.version_info < (3, 10))' || {
    echo "setup: $("$python" --version) is too old; expected 3.10 or newer. Name another with PYTHON=…" >&2; exit 2; }

missing=""
[ -d .venv ] || "$python" -c 'import ensurepip, venv' 2>/dev/null || missing="python3-venv"
if [ "$(uname)" = Linux ]; then
    for pair in libusb-1.0.so.0:libusb-1.0-0 libGL.so.1:libgl1 libEGL.so.1:libegl1 libX11.so.6:libx11-6 \
                libudev.so.1:libudev1 libgomp.so.1:libgomp1 libatomic.so.1:libatomic1; do
        "$python" -c "import ctypes; ctypes.CDLL('${pair%%:*}')" 2>/dev/null || missing="$missing ${pair##*:}"
    done
fi
if [ -n "$missing" ]; then
    if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
        echo "setup: installing$missing"
        apt-get update -qq && DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $missing
    else
        echo "setup: these system packages are missing: $missing" >&2
        echo "setup: install them (Debian, Ubuntu: sudo apt-get install $missing) and try again." >&2
        exit 2
    fi
fi

[ -x .venv/bin/python ] || "$python" -m venv .venv
echo "setup: installing unshade${extras:+[$extras]} and what it needs into .venv (about 1.5 GB; minutes the first time)"
install() { .venv/bin/python -m pip install --quiet --disable-pip-version-check "$@"; }
lock=requirements.lock
[ "$extras" != test ] || lock=requirements-test.lock
here="$(.venv/bin/python -c 'import platform as p, sys; print(p.python_implementation(), "%d.%d" % sys.version_info[:2], "on", sys.platform, p.machine())')"
if [ "${LOCKED:-yes}" = yes ] && [ "$here" = "$(sed -n 's/^# Made for: //p' "$lock")" ]; then
    install --require-hashes --requirement "$lock" || {
        echo "setup: the versions in $lock could not be installed, or their files have other digests." >&2
        echo "setup: expected the files that the package index had when the lock was written. Try again, or take" >&2
        echo "setup: the newest versions that pyproject.toml allows, unchecked: LOCKED=no sh setup.sh $extras" >&2
        exit 1
    }
fi
install --editable ".${extras:+[$extras]}"
