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

# What is installed for EXTRAS: for the tests the very versions of constraints.txt.
wanted() {
    cat pyproject.toml
    if [ "$1" = '[test]' ]; then
        cat constraints.txt
    fi
}

# prepare_environment EXTRAS: .venv with the package, its dependencies and EXTRAS ("" or "[test]").
# A stamp remembers what was wanted when it was installed.
prepare_environment() {
    local extras=$1 python constraints=()
    if wanted "$extras" | cmp -s - ".venv/installed$extras" \
        || wanted '[test]' | cmp -s - '.venv/installed[test]'; then
        return
    fi
    if [ ! -x .venv/bin/pip ]; then
        python=$(find_python)
        echo "making .venv with $("$python" --version) ..." >&2
        "$python" -m venv .venv
    fi
    echo "installing gtsam-nav$extras into .venv, once ..." >&2
    if [ "$extras" = '[test]' ]; then
        constraints=(--constraint constraints.txt)
    fi
    # the pip that comes with Python 3.11 can do all that is needed; what is imported compiles itself
    .venv/bin/python -m pip install --quiet --no-compile "${constraints[@]}" --editable ".$extras"
    wanted "$extras" >".venv/installed$extras"
}
