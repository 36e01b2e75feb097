// SPDX-License-Identifier: Apache-2.0
#include "apps/qos_command.h"

#include <CLI/CLI.hpp>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>

#include "apps/config_file.h"
#include "apps/link_profiles.h"
#include "comms/qos_xml.h"

namespace covey {
namespace {

struct Options {
  std::string profile, profiles_file, config_file;
  bool xml = false;
};

AgentConfig configuration(const Options& options) {
  AgentConfig config;
  if (!options.config_file.empty()) config = read_config(options.config_file);
  if (!options.profile.empty()) config.link_profile.name = options.profile;
  if (!options.profiles_file.empty()) config.link_profile.file = options.profiles_file;
  config.link.profile = read_profile(config.link_profile, "covey qos");
  config.link.agent = config.agent.name;
  config.link.full_messages = config.collaboration.exchange != ExchangeMode::kCompact;
  return config;
}

void list(const Options& options) {
  for (const ProfileName& profile : profile_names(options.profiles_file))
    std::printf("%-12s %s\n", profile.name.c_str(), profile.why.c_str());
}

void run(const Options& options) {
  const bool chosen = !options.profile.empty() || !options.config_file.empty();
  if (!chosen && options.xml) throw CLI::RequiredError("--profile or --config");
  if (!chosen) return list(options);
  const AgentConfig config = configuration(options);
  if (options.xml)
    std::printf("%s", qos_xml(config.link).c_str());
  else
    std::printf("%s\n", profile_with_reasons(config.link_profile, "covey qos").dump(2).c_str());
}

}  // namespace

void add_qos_command(CLI::App& covey) {
  const auto options = std::make_shared<Options>();
  CLI::App* command = covey.add_subcommand(
      "qos", "Profiles of the link: their names, their values with reasons, or as Fast DDS XML");
  command->footer(
      "Example: covey qos\n"
      "         covey qos --profile narrowband\n"
      "         covey qos --config uav0.json --xml > uav0_dds.xml");
  command->add_option("--profile", options->profile, "Its values, each with its reason")
      ->type_name("NAME");
  command->add_option("--profiles", options->profiles_file, "Own profiles instead of the program's")
      ->type_name("FILE.json");
  command
      ->add_option("--config", options->config_file,
                   "The profile of a drone's settings, with what they override")
      ->type_name("FILE.json");
  command->add_flag("--xml", options->xml, "As XML profiles that Fast DDS loads");
  command->callback([options] { run(*options); });
}

}  // namespace covey
