# Sourced by the scripts beside it: makes .venv and installs the package into it where needed.
# shellcheck shell=bash

# The first interpreter on the path that is Python 3.11 or newer.
find_python() {
    local candidate
    for candidate in python3 python3.11 python3.12 python3.13 python3.14 python; do
        if "$candidate" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; then
            echo "$candidate"
            return
        fi
    done
    echo "Python 3.11 or newer is needed and was not found on the PATH" >&2
    return 1
}

# prepare_environment EXTRAS: .venv with the package, its dependencies and EXTRAS ("" or "[test]").
# A stamp, a copy of pyproject.toml, remembers what was installed.
prepare_environment() {
    local extras=$1 python
    if cmp -s pyproject.toml ".venv/installed$extras" || cmp -s pyproject.toml ".venv/installed[test]"; then
        return
    fi
    if [ ! -x .venv/bin/pip ]; then
        python=$(find_python)
        echo "making .venv with $("$python" --version) ..." >&2
        "$python" -m venv .venv
    fi
    echo "installing gtsam-nav$extras into .venv, once ..." >&2
    # the pip that comes with Python 3.11 can do all that is needed
    .venv/bin/python -m pip install --quiet --editable ".$extras"
    cp pyproject.toml ".venv/installed$extras"
}
