# Sourced by scripts: makes an environment of Python for them.

# `python_environment FOLDER REQUIREMENTS`: has these packages and no others. It is complete only if it says which requirements it
# was made of. It fails only where a package cannot be had: one that lacks another is a fault, which its user shows.
python_environment() {
    if cmp -s "$2" "$1/requirements.txt"; then
        return 0
    fi
    rm -rf "$1"
    python3 -m venv "$1" &&
        "$1/bin/pip" install --quiet --disable-pip-version-check --no-deps --requirement "$2" &&
        cp "$2" "$1/requirements.txt"
}
