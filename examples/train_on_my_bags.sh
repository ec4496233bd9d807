#!/usr/bin/env bash
# SPDX-License-Identifier: Apache-2.0
# Train on bags of one's own: examples/train_on_my_bags.sh OUT CUT.toml BAG... ; EPOCHS=3 for a first look.
# CUT.toml names tracker, robot and joints (see ./mild demonstrations --help); labels were published on /label.
set -eu
here=$(cd "$(dirname "$0")/.." && pwd)
out=$1 cut=$2
shift 2
"$here/mild" demonstrations "$@" --config "$cut" --label topic:/label --test-every 3 --out "$out/trials"
"$here/mild" train --dataset "$out/trials" ${EPOCHS:+--epochs "$EPOCHS"} --members 1 --out "$out/model"
"$here/mild" evaluate --model "$out/model" --dataset "$out/trials" --split test
echo "run it: ./mild run pipeline -p model:=$out/model"
