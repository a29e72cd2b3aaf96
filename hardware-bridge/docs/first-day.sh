#!/bin/sh
# The first day with a hand, on emulated devices: from an empty folder to a trial with touch that is replayed and drawn.
#
#   FTAC=target/release/ftac hardware-bridge/docs/first-day.sh FOLDER [POLICY]
#
# Answers that an operator would give are piped in. With a viewer installed, the last step opens the recording.
set -eu
ftac=${FTAC:-ftac}
folder=${1:?usage: first-day.sh FOLDER [POLICY]}
policy=${2:-touch}
mkdir "$folder"
config=$folder/hand/bridge.toml

step() {
    echo "== $*"
}

"$ftac" bridge emulate --dir "$folder/hand" --patient --mount 1 --balls --detector "unix:$folder/eyes" \
    --truth "$folder/truth.rrd" </dev/null >"$folder/emulator.log" 2>&1 &
emulator=$!
trap 'kill $emulator' EXIT
until [ -e "$config" ]; do
    kill -0 $emulator
    sleep 0.2
done

step "who is on the bus"
"$ftac" bridge scan --config "$config"
step "open marks and travels, from cold"
echo yes | "$ftac" bridge calibrate --config "$config"
step "is everything as it should be"
if "$ftac" bridge doctor --quiet --store-references --config "$config"; then
    echo "every row is ok"
else
    echo "not every row is ok: of real devices that is mended before anything moves"
fi
step "first motion"
echo yes | "$ftac" bridge exercise --config "$config"

step "where the base stands: balls on three marks"
"$ftac" bridge register --dry-run
printf 'yes\nrelease\n' | "$ftac" bridge register --config "$config"
step "objects for the trial"
"$ftac" bridge emulate --dir "$folder/hand" --send objects=0

step "a trial"
# Enter, then yes to every question, as often as there may be one; the hand keeps what it holds.
answers() {
    echo
    for _ in $(seq 60); do echo yes; done
}
verdict=0
answers | "$ftac" trial 0 --policy "$policy" --robot hardware --config "$config" \
    --registration "$folder/hand/registration.toml" --detector "unix:$folder/eyes" \
    --session "$folder/sessions" --out "$folder/live.rrd" || verdict=$?
# 1 is a trial that failed, which is a result too.
[ $verdict -le 1 ]
"$ftac" bridge stop --release --config "$config" || true

session=$(echo "$folder"/sessions/*.mcap)
step "the same decisions again, from the recording"
"$ftac" replay "$session"
step "drawn again, from the recording"
"$ftac" export rrd "$session" --out "$folder/again.rrd"
ls -l "$folder/live.rrd" "$folder/again.rrd"
if [ -n "${RERUN_BIN:-}" ] || command -v rerun >/dev/null; then
    step "on screen"
    "$ftac" view "$folder/again.rrd"
fi
