#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
#
# Who may include whom. Prints every include that goes against the picture in CONVENTIONS.md as
# file:line: reason, and fails if there is one.
#   include_directions.sh ROOT
set -euo pipefail
cd "$1"

shopt -s nullglob
files=({estimator,frontend,comms,sim,apps}/*.{h,cpp} tests/*.{h,cpp} tests/*/*.{h,cpp})
((${#files[@]} > 0)) || { echo "include_directions: no sources below $1" >&2; exit 2; }

awk '
function complain(reason) {
  printf "%s:%d: %s: %s\n", FILENAME, FNR, header, reason
  bad = 1
}
BEGIN {
  seam = "estimator/(measurements|bearing|so3|median|config)[.]h"
  project["estimator"] = "^estimator/"
  project["frontend"] = "^(frontend/|" seam "$)"
  project["comms"] = "^(comms/|" seam "$|estimator/filter_snapshot[.]h$)"
  project["sim"] = "^(sim/|" seam "$|frontend/camera[.]h$)"
  project["apps"] = "^(apps|sim|frontend|comms|estimator)/"
  library["estimator"] = "^Eigen/"
  library["frontend"] = "^(Eigen|opencv2)/"
  posix = "(unistd|ifaddrs|netdb)[.]h$|(arpa|net|netinet|sys)/"
  library["comms"] = "^((Eigen|fastdds|fastrtps|fastcdr|openssl)/|" posix ")"
  library["sim"] = "^((Eigen|opencv2)/|spng[.]h$|" posix ")"
  library["apps"] = "/|[.]h$"
  # Threads, files, clocks and printing belong to apps.
  forbidden_std["estimator"] = "^(thread|mutex|shared_mutex|condition_variable|future|chrono|ctime|" \
                               "fstream|iostream|cstdio|filesystem)$"
  forbidden_std["frontend"] = "^(iostream|cstdio)$"
}
/^[ \t]*#[ \t]*include[ \t]*[<"]/ {
  header = $0
  sub(/^[^<"]*[<"]/, "", header)
  sub(/[>"].*$/, "", header)
  quoted = $0 ~ /include[ \t]*"/
  room = FILENAME
  sub(/\/.*$/, "", room)

  if (header ~ /^opencv2\/(imgcodecs|highgui|opencv)/) complain("drags in GDAL or a window system")
  if (header ~ /^(fastdds|fastrtps|fastcdr)\// && room != "comms" && FILENAME !~ /^tests\/comms\//)
    complain("Fast DDS is seen by comms alone")
  if (room == "comms" && FILENAME ~ /[.]h$/ && header ~ /PubSubTypes[.]h$|CdrAux/)
    complain("generated types never leave comms")
  if (room == "tests") next

  if (quoted) {
    # Generated code is the one thing included from outside the project root.
    if (room == "comms" && FILENAME ~ /[.]cpp$/ && header ~ /^(idl\/)?[^\/]*$/) next
    if (header !~ project[room]) complain(room " may not know it")
  } else if (header ~ /[\/.]/) {
    if (header !~ library[room]) complain(room " may not know this library")
  } else if (room in forbidden_std && header ~ forbidden_std[room]) {
    complain(room " has no threads, files, clocks or printing")
  }
}
END { exit bad }
' "${files[@]}"
