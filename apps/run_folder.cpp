// SPDX-License-Identifier: Apache-2.0
#include "apps/run_folder.h"

#include <fcntl.h>
#include <sys/file.h>

#include <cerrno>
#include <stdexcept>
#include <string>
#include <system_error>
#include <utility>
#include <vector>

#include "apps/agent.h"
#include "apps/run_files.h"

namespace covey {
namespace {

namespace fs = std::filesystem;

constexpr char kEarlierRun[] = ".earlier";

void add_if_there(const fs::path& file, std::vector<fs::path>& files) {
  if (fs::exists(file)) files.push_back(file);
}

void add_files_of(const fs::path& run, std::vector<fs::path>& files) {
  for (const char* name : {"summary.json", "report.html"}) add_if_there(run / name, files);
  for (const auto& entry : fs::directory_iterator(run)) {
    if (!entry.is_directory() || !fs::exists(entry.path() / kAgentConfigFile)) continue;
    for (const char* name : {kAgentConfigFile, kAgentSummaryFile, kAgentStatusFile})
      add_if_there(entry.path() / name, files);
    for (const char* name : kRunFiles) add_if_there(entry.path() / name, files);
  }
}

// Only what a run writes, with the drones flown alone.
std::vector<fs::path> files_of(const fs::path& run) {
  std::vector<fs::path> files;
  add_files_of(run, files);
  if (fs::is_directory(run / kSoloFolder)) add_files_of(run / kSoloFolder, files);
  return files;
}

std::vector<fs::path> all_files_below(const fs::path& folder) {
  std::vector<fs::path> files;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (!entry.is_directory()) files.push_back(entry.path());
  }
  return files;
}

// The folders between `run` and the file, as far as they are empty.
void remove_emptied(const fs::path& file, const fs::path& run) {
  for (fs::path folder = file.parent_path(); folder != run && fs::is_empty(folder);
       folder = folder.parent_path()) {
    fs::remove(folder);
  }
}

void move_files(const std::vector<fs::path>& files, const fs::path& from, const fs::path& to) {
  for (const fs::path& file : files) {
    const fs::path target = to / file.lexically_relative(from);
    fs::create_directories(target.parent_path());
    fs::rename(file, target);
    remove_emptied(file, from);
  }
}

// Until it is closed, also by a death of the process. Where the file system has no locks, nobody is
// kept away.
FileDescriptor locked(const fs::path& run) {
  FileDescriptor folder(::open(run.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  if (::flock(folder.get(), LOCK_EX | LOCK_NB) != 0 && errno == EWOULDBLOCK)
    throw std::runtime_error(run.string() + ": another covey flies into it");
  return folder;
}

}  // namespace

RunFolder::RunFolder(fs::path run, bool replace) : run_(std::move(run)) {
  std::error_code error;
  fs::create_directories(run_, error);
  if (error) throw std::runtime_error(run_.string() + ": cannot be made: " + error.message());
  lock_ = locked(run_);
  if (!fs::is_empty(run_) && !replace) {
    throw std::runtime_error(run_.string() +
                             " is not empty: choose another folder, or --force to replace it");
  }
  if (fs::exists(run_ / kEarlierRun)) put_back();  // of a start that was killed
  move_files(files_of(run_), run_, run_ / kEarlierRun);
}

RunFolder::~RunFolder() {
  if (kept_) return;
  try {
    put_back();
    if (fs::is_empty(run_)) fs::remove(run_);
  } catch (const fs::filesystem_error&) {
    // What could not be put back stays where it has been set aside.
  }
}

void RunFolder::keep() {
  if (!kept_) fs::remove_all(run_ / kEarlierRun);
  kept_ = true;
}

void RunFolder::put_back() const {
  for (const fs::path& file : files_of(run_)) {
    fs::remove(file);
    remove_emptied(file, run_);
  }
  const fs::path earlier = run_ / kEarlierRun;
  if (!fs::exists(earlier)) return;
  move_files(all_files_below(earlier), earlier, run_);
  fs::remove(earlier);
}

}  // namespace covey
