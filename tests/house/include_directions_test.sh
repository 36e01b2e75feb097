#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
#
# The include check must find what it is there for: each line below is planted alone in a copy of
# the sources, and has to be reported.
#   include_directions_test.sh ROOT
set -euo pipefail
check=$(dirname "$0")/include_directions.sh
copy=$(mktemp -d)
trap 'rm -rf "$copy"' EXIT
mkdir "$copy/tests"
for room in estimator frontend comms sim apps; do
  cp -r "$1/$room" "$copy/" 2>/dev/null || mkdir "$copy/$room"
done
bash "$check" "$copy" || { echo "the copy is not clean before anything is planted"; exit 1; }

missed=0
plant() {
  local file=$1 line=$2 reason=$3 complaints
  echo "$line" >"$copy/$file"
  if complaints=$(bash "$check" "$copy") || ! grep -q "^$file:1: .*$reason" <<<"$complaints"; then
    echo "not found: $line in $file"
    missed=1
  fi
  rm "$copy/$file"
}
plant estimator/planted.cpp '#include <opencv2/core.hpp>' 'may not know this library'
plant estimator/planted.cpp '#include <thread>' 'no threads'
plant estimator/planted.h '#include <chrono>' 'no threads, files, clocks'
plant estimator/planted.h '#include <iostream>' 'or printing'
plant estimator/planted.h '#include "frontend/camera.h"' 'may not know it'
plant frontend/planted.cpp '#include "estimator/estimator.h"' 'may not know it'
plant frontend/planted.cpp '#include "comms/peer_link.h"' 'may not know it'
plant frontend/planted.cpp '# include <opencv2/imgcodecs.hpp>' 'GDAL'
plant comms/planted.h '#include "CoveyPubSubTypes.h"' 'generated types'
plant comms/planted.cpp '#include "frontend/tracker.h"' 'may not know it'
plant comms/planted.cpp '#include <opencv2/core.hpp>' 'may not know this library'
plant sim/planted.cpp '#include "frontend/tracker.h"' 'may not know it'
plant sim/planted.cpp '#include "apps/dataset.h"' 'may not know it'
plant comms/planted.cpp '#include "sim/scene.h"' 'may not know it'
plant apps/planted.cpp '#include <fastdds/dds/topic/Topic.hpp>' 'comms alone'
plant tests/planted.cpp '#include <opencv2/highgui.hpp>' 'GDAL'
exit $missed
