// SPDX-License-Identifier: Apache-2.0
#include "apps/results.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <functional>
#include <iterator>
#include <optional>
#include <stdexcept>

#include "apps/printed_results.h"

namespace covey {
namespace {

namespace fs = std::filesystem;

using Value = std::optional<double>;
using FromAgent = std::function<Value(const AgentRun&)>;

std::string text(const Value& value, int decimals) {
  return value ? fmt::format("{:.{}f}", *value, decimals) : "-";
}

// Of a table in Markdown.
std::string row(const std::vector<std::string>& cells) {
  std::string line = "|";
  for (const std::string& cell : cells) line += " " + cell + " |";
  return line + "\n";
}

std::string head(const std::vector<std::string>& titles) {
  return row(titles) + row(std::vector<std::string>(titles.size(), "---"));
}

std::string name_of(const ScenarioResults& results) {
  return results.scenario + ", seed " + results.seed;
}

// ------------------------------------------------------------------------------- figures of a run

Value error_m(const std::optional<AccuracySummary>& accuracy) {
  if (!accuracy) return std::nullopt;
  return accuracy->se3.rmse;
}

std::string error_text(const std::optional<AccuracySummary>& accuracy) {
  if (!accuracy) return "-";
  return fmt::format("{:.4f}±{:.4f}", accuracy->se3.rmse, accuracy->se3.std);
}

// By how much less the error is, of the error alone.
std::string improvement(const Value& alone, const Value& together) {
  if (!alone || !together || *alone <= 0) return "-";
  return fmt::format("{:.1f} %", 100 * (*alone - *together) / *alone);
}

// Over the drones that have it.
Value total(const RunData& run, const FromAgent& get) {
  Value sum;
  for (const AgentRun& agent : run.agents) {
    if (const Value value = get(agent)) sum = sum.value_or(0) + *value;
  }
  return sum;
}

Value mean(const RunData& run, const FromAgent& get) {
  const Value sum = total(run, get);
  if (!sum) return std::nullopt;
  const auto count = std::count_if(run.agents.begin(), run.agents.end(),
                                   [&](const AgentRun& agent) { return get(agent).has_value(); });
  return *sum / static_cast<double>(count);
}

FromAgent of_link(const std::function<std::int64_t(const LinkSummary&)>& get) {
  return [get](const AgentRun& agent) -> Value {
    if (!agent.summary.link) return std::nullopt;
    return static_cast<double>(get(*agent.summary.link));
  };
}

const FromAgent kQuestions = of_link([](const LinkSummary& l) { return l.request.sent; });
const FromAgent kMessages = of_link([](const LinkSummary& l) { return l.message.sent; });
const FromAgent kPayload = of_link([](const LinkSummary& l) {
  return l.request.payload_bytes_sent + l.message.payload_bytes_sent;
});
const FromAgent kWire = of_link([](const LinkSummary& l) { return l.wire_bytes_sent.value_or(0); });

// kB/s that one drone sends.
Value rate(const RunData& run, const FromAgent& bytes) {
  return mean(run, [&](const AgentRun& agent) -> Value {
    const Value sent = bytes(agent), seconds = flown_s(agent);
    if (!sent || !seconds) return std::nullopt;
    return *sent / *seconds / 1e3;
  });
}

Value megabytes(const Value& bytes) {
  if (!bytes) return std::nullopt;
  return *bytes / 1e6;
}

// ----------------------------------------------------------------------------------------- tables

const PrintedError* printed_error(const std::string& scenario, const std::string& drone) {
  const auto* found = std::find_if(
      std::begin(kPrintedErrors), std::end(kPrintedErrors),
      [&](const PrintedError& e) { return e.scenario == scenario && e.drone == drone; });
  return found == std::end(kPrintedErrors) ? nullptr : found;
}

std::string error_row(const ScenarioResults& results, const AgentRun& agent) {
  const auto& alone = agent.alone_accuracy;
  std::vector<std::string> cells = {name_of(results),
                                    agent.name,
                                    text(agent.summary.distance_m, 1),
                                    error_text(alone),
                                    error_text(agent.accuracy),
                                    improvement(error_m(alone), error_m(agent.accuracy))};
  if (const PrintedError* printed = printed_error(results.scenario, agent.name)) {
    cells.insert(cells.end(),
                 {fmt::format("{:.4f}±{:.4f}", printed->alone, printed->alone_std),
                  fmt::format("{:.4f}±{:.4f}", printed->together, printed->together_std),
                  improvement(printed->alone, printed->together)});
  } else {
    cells.insert(cells.end(), {"-", "-", "-"});
  }
  return row(cells);
}

std::string error_table(const std::vector<ScenarioResults>& all) {
  std::string rows;
  for (const ScenarioResults& results : all) {
    if (results.raw) continue;
    for (const AgentRun& agent : results.compact.agents) rows += error_row(results, agent);
  }
  if (rows.empty()) return "";
  return "### Visual cameras\n\n" +
         head({"flight", "drone", "path, m", "alone", "together", "improvement", "paper: alone",
               "paper: together", "paper: improvement"}) +
         rows + "\n";
}

// Alone or together, on raw or on calibrated images.
struct ThermalColumn {
  const char* title;
  bool raw;
  std::optional<AccuracySummary> AgentRun::*ours;
  PrintedRmse PrintedThermalError::*printed;
};
constexpr ThermalColumn kThermalColumns[] = {
    {"alone, raw", true, &AgentRun::alone_accuracy, &PrintedThermalError::alone_raw},
    {"alone, calibrated", false, &AgentRun::alone_accuracy, &PrintedThermalError::alone_calibrated},
    {"together, raw", true, &AgentRun::accuracy, &PrintedThermalError::together_raw},
    {"together, calibrated", false, &AgentRun::accuracy, &PrintedThermalError::together_calibrated},
};

const RunData& run_of(const ThermalColumn& column, const ScenarioResults& results) {
  return column.raw ? *results.raw : results.compact;
}

std::string thermal_error_text(const ThermalColumn& column, const ScenarioResults& results,
                               const std::string& drone) {
  for (const AgentRun& agent : run_of(column, results).agents) {
    if (agent.name == drone) return error_text(agent.*column.ours);
  }
  return "-";
}

std::string printed_text(const ThermalColumn& column, const ScenarioResults& results,
                         const std::string& drone) {
  for (const PrintedThermalError& printed : kPrintedThermalErrors) {
    if (printed.scenario != results.scenario || printed.drone != drone) continue;
    const PrintedRmse& error = printed.*column.printed;
    return fmt::format("{:.4f}±{:.4f}", error.rmse, error.std);
  }
  return "-";
}

Value mean_printed(const ThermalColumn& column, const ScenarioResults& results) {
  double sum = 0;
  int drones = 0;
  for (const PrintedThermalError& printed : kPrintedThermalErrors) {
    if (printed.scenario != results.scenario) continue;
    sum += (printed.*column.printed).rmse;
    ++drones;
  }
  if (drones == 0) return std::nullopt;
  return sum / drones;
}

std::string thermal_error_row(const ScenarioResults& results, const AgentRun& agent) {
  std::vector<std::string> cells = {name_of(results), agent.name,
                                    text(agent.summary.distance_m, 1)};
  for (const ThermalColumn& column : kThermalColumns)
    cells.push_back(thermal_error_text(column, results, agent.name));
  for (const ThermalColumn& column : kThermalColumns)
    cells.push_back(printed_text(column, results, agent.name));
  return row(cells);
}

std::string thermal_mean_row(const ScenarioResults& results) {
  std::vector<std::string> cells = {name_of(results), "**mean**", "-"};
  for (const ThermalColumn& column : kThermalColumns) {
    const auto error = [&](const AgentRun& agent) { return error_m(agent.*column.ours); };
    cells.push_back(text(mean(run_of(column, results), error), 4));
  }
  for (const ThermalColumn& column : kThermalColumns)
    cells.push_back(text(mean_printed(column, results), 4));
  return row(cells);
}

std::string thermal_error_table(const std::vector<ScenarioResults>& all) {
  std::string rows;
  for (const ScenarioResults& results : all) {
    if (!results.raw) continue;
    for (const AgentRun& agent : results.compact.agents) rows += thermal_error_row(results, agent);
    rows += thermal_mean_row(results);
  }
  if (rows.empty()) return "";
  std::vector<std::string> titles = {"flight", "drone", "path, m"};
  for (const ThermalColumn& column : kThermalColumns) titles.emplace_back(column.title);
  for (const ThermalColumn& column : kThermalColumns)
    titles.push_back(std::string("paper: ") + column.title);
  return "### Thermal cameras\n\nRaw: images as they are (`--thermal raw`). Calibrated: as Covey "
         "flies thermal cameras. The paper's baseline, xVIO, is alone on raw images.\n\n" +
         head(titles) + rows + "\n";
}

std::string data_row(const ScenarioResults& results, const RunData& run) {
  const Value questions = total(run, kQuestions), messages = total(run, kMessages);
  const Value payload = total(run, kPayload), least = total(results.compact, kPayload);
  const Value wire = total(run, kWire), least_wire = total(results.compact, kWire);
  Value printed_size;
  if (questions && messages) {
    printed_size =
        (*messages * kPrintedMessageKilobytes + *questions * kPrintedRequestKilobytes) / 1e3;
  }
  const bool compact = &run == &results.compact;
  const auto times = [&](const Value& value, const Value& reference) {
    return value && reference && *reference > 0 ? fmt::format("{:.0f}", *value / *reference) : "-";
  };
  return row({name_of(results), run.summary.exchange.value_or("-"), text(questions, 0),
              text(messages, 0), text(megabytes(payload), 2), text(rate(run, kPayload), 1),
              text(megabytes(wire), 2), text(rate(run, kWire), 1),
              times(payload, least) + " / " + times(wire, least_wire),
              compact ? "-" : text(printed_size, 1),
              text(mean(run, [](const AgentRun& a) { return error_m(a.accuracy); }), 4)});
}

std::string data_table(const std::vector<ScenarioResults>& all) {
  std::string table =
      head({"flight", "exchange", "questions", "messages", "payload, MB", "payload, kB/s per drone",
            "wire, MB", "wire, kB/s per drone", "times compact, payload / wire",
            "MB at the paper's sizes", "mean error, m"});
  for (const ScenarioResults& results : all) {
    for (const RunData* run : {&results.compact, &results.paper, &results.naive}) {
      table += data_row(results, *run);
    }
  }
  return table;
}

// How many times what our team sends on the same scenario, the first of them.
std::string times_ours(const std::vector<ScenarioResults>& all, const std::string& scenario,
                       double printed_mb) {
  const auto ours = std::find_if(all.begin(), all.end(), [&](const ScenarioResults& results) {
    return results.scenario == scenario;
  });
  if (ours == all.end()) return "-";
  const Value mb = megabytes(total(ours->compact, kPayload));
  return mb && *mb > 0 ? fmt::format("{:.0f}", printed_mb / *mb) : "-";
}

std::string printed_data_table(const std::vector<ScenarioResults>& all) {
  std::string table = head({"paper: flight", "naive, MB", "its exchange: messages, MB",
                            "questions, MB", "naive / our compact", "its exchange / our compact"});
  for (const PrintedData& data : kPrintedData) {
    table += row({data.scenario, text(data.naive, 2), text(data.messages, 2),
                  text(data.requests, 2), times_ours(all, data.scenario, data.naive),
                  times_ours(all, data.scenario, data.messages + data.requests)});
  }
  return table;
}

std::string load_table(const std::vector<ScenarioResults>& all) {
  std::string table = head({"flight", "exchange", "drone", "messages sent", "max CPU, %",
                            "max memory, MiB", "CPU per image, ms", "error, m"});
  for (const ScenarioResults& results : all) {
    for (const RunData* run : {&results.compact, &results.paper, &results.naive}) {
      for (const AgentRun& agent : run->agents) {
        const Value sent = kQuestions(agent), answered = kMessages(agent);
        table += row({name_of(results), run->summary.exchange.value_or("-"), agent.name,
                      text(sent.value_or(0) + answered.value_or(0), 0),
                      text(agent.summary.max_cpu_percent, 0), text(agent.summary.max_rss_mib, 1),
                      text(agent.summary.cpu_ms_per_frame, 1), error_text(agent.accuracy)});
      }
    }
  }
  for (const PrintedLoad& load : kPrintedLoads) {
    const PrintedError* error = printed_error("castle_around", load.drone);
    table += row({"paper: castle_around", "paper", load.drone, std::to_string(load.messages),
                  text(load.max_cpu_percent, 2), text(load.max_memory_mib, 1), "-",
                  fmt::format("{:.4f}±{:.4f}", error->together, error->together_std)});
  }
  return table;
}

// One stage of ours and what the paper has in its place, ms.
struct Module {
  const char* name;
  std::optional<double> StageSummary::*ours;
  const char* printed;
};
constexpr Module kModules[] = {
    {"photometric calibration", &StageSummary::thermal, "22.53"},
    {"tracking", &StageSummary::track, "13.45"},
    {"ORB descriptors", &StageSummary::describe, "-"},
    {"place descriptor and look-up (VLAD, loop closure)", &StageSummary::place, "0.08 + 3.03"},
    {"matching with peers' features", &StageSummary::match, "7.19"},
    {"IMU propagation", &StageSummary::propagate, "-"},
    {"MSCKF update (MultiMSCKF and MSCKF)", &StageSummary::msckf, "1.15 + 3.18"},
    {"SLAM update", &StageSummary::slam, "-"},
    {"fusion of peers (MultiSLAM)", &StageSummary::peer, "2.46"},
};

// The mean of the drones; nothing if the stage ran on none.
Value module_ms(const RunData& run, const Module& module) {
  return mean(run, [&](const AgentRun& agent) { return agent.summary.stage_ms.*module.ours; });
}

std::string time_table(const std::vector<ScenarioResults>& all) {
  std::vector<std::string> titles = {"module, ms"};
  for (const ScenarioResults& results : all) titles.push_back(name_of(results));
  titles.emplace_back("paper");
  std::string table = head(titles);
  std::vector<std::string> sums = {"**total**"};
  for (const Module& module : kModules) {
    std::vector<std::string> cells = {module.name};
    for (const ScenarioResults& results : all) {
      cells.push_back(text(module_ms(results.compact, module), 2));
    }
    cells.emplace_back(module.printed);
    table += row(cells);
  }
  for (const ScenarioResults& results : all) {
    double sum = 0;
    for (const Module& module : kModules) sum += module_ms(results.compact, module).value_or(0);
    sums.push_back(text(sum, 2));
  }
  sums.emplace_back("53.07");
  return table + row(sums);
}

RunData read_exchange(const fs::path& flight, const char* exchange) {
  const fs::path run = flight / exchange;
  if (!fs::exists(run / "summary.json")) {
    throw std::runtime_error(run.string() + " holds no run: fly it with covey team --exchange " +
                             exchange + " --out " + run.string());
  }
  RunData data = read_run(run);
  if (data.summary.exchange != exchange) {
    throw std::runtime_error((run / "summary.json").string() + ": was flown with --exchange " +
                             data.summary.exchange.value_or("of a kind that it does not tell") +
                             ", not " + exchange);
  }
  return data;
}

bool is_calibrated(const RunData& run) {
  return std::any_of(run.agents.begin(), run.agents.end(), [](const AgentRun& agent) {
    return agent.summary.stage_ms.thermal.has_value();
  });
}

RunData read_raw(const fs::path& flight) {
  const fs::path run = flight / "raw";
  if (!fs::exists(run / "summary.json")) {
    throw std::runtime_error(
        run.string() + " holds no run: fly it with covey team --thermal raw --with-solo --out " +
        run.string());
  }
  RunData data = read_run(run);
  if (is_calibrated(data)) {
    throw std::runtime_error((run / "summary.json").string() +
                             ": images were calibrated, was not flown with --thermal raw");
  }
  return data;
}

}  // namespace

std::vector<ScenarioResults> read_results(const fs::path& runs) {
  if (!fs::is_directory(runs))
    throw std::runtime_error(runs.string() + ": is not a folder: is the path right?");
  std::vector<fs::path> flights;
  for (const auto& entry : fs::directory_iterator(runs)) {
    if (entry.is_directory()) flights.push_back(entry.path());
  }
  std::sort(flights.begin(), flights.end());
  std::vector<ScenarioResults> results;
  for (const fs::path& flight : flights) {
    const std::string name = flight.filename().string();
    const std::size_t dash = name.rfind('-');
    if (dash == std::string::npos) {
      throw std::runtime_error(flight.string() + " is not named <scenario>-<seed>");
    }
    results.push_back({name.substr(0, dash), name.substr(dash + 1),
                       read_exchange(flight, "compact"), read_exchange(flight, "paper"),
                       read_exchange(flight, "naive"), std::nullopt});
    if (is_calibrated(results.back().compact)) results.back().raw = read_raw(flight);
  }
  if (results.empty()) throw std::runtime_error(runs.string() + " holds no flights");
  return results;
}

std::string results_page(const std::vector<ScenarioResults>& results, const ResultsOrigin& origin) {
  return "# Results\n\n"
         "The paper's tables, ours beside the printed ones. Made by `" +
         origin.command + "` at commit " + origin.commit + " on " + origin.machine +
         ". Simulated flights, starts from ground truth, lockstep: no image is dropped. The paper "
         "flew other images of the same scenarios, so its errors are no yardstick for ours; its "
         "data usage is.\n\n"
         "## Absolute trajectory error\n\n"
         "RMSE ± standard deviation, m, aligned by SE(3). Together: exchange `compact`.\n\n" +
         error_table(results) + thermal_error_table(results) +
         "## Data usage\n\n"
         "Sums over the team. Payload: serialised questions and messages; a message to all counts "
         "once, as in the paper. Wire: measured, every IPv4 packet that the drones sent, with "
         "discovery, status, odometry, acknowledgements and repair (discovery and liveliness go on "
         "by the clock, so a slow machine's lockstep adds to them); a message to all goes to each "
         "drone. Messages of `paper` and `naive` hold the whole filter, up to 207 states in "
         "ours, so they are larger than the 190.7 kB printed: the last column but one counts ours "
         "at the printed sizes. As in the paper they have descriptors of their landmarks and no "
         "pictures; `compact` sends pictures.\n\n" +
         data_table(results) + "\n" + printed_data_table(results) +
         "\n## Messages, CPU and memory\n\n"
         "One core is 100 %. Lockstep runs as fast as the machine allows, so the CPU's maximum "
         "says how much of a core one process gets, not how much it needs at 30 Hz: that is the "
         "time per image.\n\n" +
         load_table(results) +
         "\n## Time per module\n\n"
         "CPU ms per image, mean of the drones, exchange `compact`.\n\n" +
         time_table(results);
}

}  // namespace covey
