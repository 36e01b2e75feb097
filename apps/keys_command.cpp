// SPDX-License-Identifier: Apache-2.0
#include "apps/keys_command.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "apps/config_json.h"
#include "apps/team_keys.h"

namespace covey {
namespace {

struct Options {
  std::string out, team;
  std::vector<std::string> drones, added, revoked;
  int days = 365;
  std::optional<int> domain;
  bool force = false;
};

void make(const Options& options) {
  DomainRange domains;
  if (options.domain) domains = {*options.domain, *options.domain};
  make_team_keys({options.out, options.drones, options.days}, options.team, domains, options.force);
  std::printf("%s: keys of team %s. Copy each drone's folder (%s) to it, and keep team.authority\n",
              options.out.c_str(), options.team.c_str(), join(options.drones, ", ").c_str());
}

void add(const Options& options) {
  add_team_keys({options.out, options.added, options.days});
  std::printf("%s: new keys of %s; the others need nothing new\n", options.out.c_str(),
              join(options.added, ", ").c_str());
}

void revoke(const Options& options) {
  revoke_team_keys({options.out, options.revoked});
  std::printf(
      "%s: keys of %s revoked. Copy revoked.pem from each drone's folder to it, and start it "
      "again\n",
      options.out.c_str(), join(options.revoked, ", ").c_str());
}

void run(const Options& options) {
  if (!options.added.empty()) return add(options);
  if (!options.revoked.empty()) return revoke(options);
  if (options.team.empty()) throw CLI::RequiredError("one of --team, --add and --revoke");
  if (options.drones.empty()) throw CLI::RequiredError("the names of the drones");
  make(options);
}

}  // namespace

void add_keys_command(CLI::App& covey) {
  const auto options = std::make_shared<Options>();
  CLI::App* command =
      covey.add_subcommand("keys", "Certificates and signed permissions of a team (DDS Security)");
  command->footer(
      "Example: covey keys --team blue --out keys uav0 uav1 uav2   # a new team\n"
      "         covey keys --out keys --add uav3\n"
      "         covey keys --out keys --revoke uav1");
  command->add_option("--out", options->out, "Folder of the team's keys")->required();
  CLI::Option* team = command->add_option("--team", options->team, "A new team; link.team");
  CLI::Option* drones =
      command->add_option("drones", options->drones, "Names of its drones")->needs(team);
  CLI::Option* added = command->add_option("--add", options->added, "Drones that join it")
                           ->excludes(team)
                           ->excludes(drones);
  command->add_option("--revoke", options->revoked, "Drones that nobody shall believe any more")
      ->excludes(team)
      ->excludes(drones)
      ->excludes(added);
  command->add_option("--days", options->days, "How long the keys of drones are valid")
      ->capture_default_str()
      ->check(CLI::Range(1, 3650));
  command->add_option("--domain", options->domain, "The only DDS domain (default: any)")
      ->needs(team)
      ->check(CLI::Range(0, 200));
  command->add_flag("--force", options->force, "Replace the keys in the folder, all of them")
      ->needs(team);
  command->callback([options] { run(*options); });
}

}  // namespace covey
