// SPDX-License-Identifier: Apache-2.0
//
// How the report looks. Drone and series colours are Okabe and Ito's (2008), which people with any
// kind of colour vision can tell apart; a little lighter on dark.
#pragma once

namespace covey {

inline constexpr char kReportStyle[] = R"css(
:root {
  color-scheme: light dark;
  --paper: #ffffff; --card: #f6f7f9; --ink: #1d232b; --muted: #66707c; --rule: #d9dee4;
  --grid: #e6e9ed; --plot: #ffffff; --truth: #c3c9d1; --sigma: #9db7d5;
  --good: #00704f; --bad: #b34700;
  --drone0: #0072b2; --drone1: #d55e00; --drone2: #009e73; --drone3: #b5588f;
  --drone4: #c98a00; --drone5: #3a9bd9;
  --series-a: #0072b2; --series-b: #d08a00; --series-c: #009e73; --series-d: #d55e00;
  --series-e: #a8507f;
  --stage-read: #b9c0c8; --stage-thermal: #1f4e79; --stage-track: #0072b2; --stage-describe: #56b4e9;
  --stage-place: #7b5aa6; --stage-match: #b79ad6; --stage-propagate: #f0c24b;
  --stage-msckf: #e08a00; --stage-slam: #c24f00; --stage-peer: #009e73;
}
@media (prefers-color-scheme: dark) {
  :root {
    --paper: #14181d; --card: #1c2229; --ink: #e8ecf0; --muted: #9aa5b1; --rule: #343c46;
    --grid: #2a323b; --plot: #171c22; --truth: #59636f; --sigma: #3d5a7c;
    --good: #4cc9a0; --bad: #ff9a5c;
    --drone0: #4aa8e0; --drone1: #ff8a3d; --drone2: #2fc79b; --drone3: #e08abb;
    --drone4: #edb83a; --drone5: #8fd0ff;
    --series-a: #4aa8e0; --series-b: #edb83a; --series-c: #2fc79b; --series-d: #ff8a3d;
    --series-e: #e08abb;
    --stage-read: #67717d; --stage-thermal: #2f6fae; --stage-track: #2b8fd0;
    --stage-describe: #7cc6f2; --stage-place: #8f6fc0; --stage-match: #c4aae6;
    --stage-propagate: #f3cf6d; --stage-msckf: #ec9d2c; --stage-slam: #d9682a;
    --stage-peer: #2fc79b;
  }
}
* { box-sizing: border-box; }
body { margin: 0; background: var(--paper); color: var(--ink);
  font: 15px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; }
main { max-width: 1240px; margin: 0 auto; padding: 28px 24px 60px; }
h1 { font-size: 27px; line-height: 1.2; margin: 0 0 8px; overflow-wrap: anywhere; }
h2 { font-size: 19px; margin: 44px 0 4px; }
h3 { font-size: 15px; margin: 18px 0 6px; display: flex; align-items: center; gap: 8px; }
p { margin: 0 0 12px; color: var(--muted); max-width: 78ch; }
.chips { display: flex; flex-wrap: wrap; gap: 6px; margin: 0 0 18px; padding: 0; list-style: none; }
.chips li { background: var(--card); border: 1px solid var(--rule); border-radius: 99px;
  padding: 1px 11px; font-size: 13px; }
.tiles { display: grid; grid-template-columns: repeat(auto-fit, minmax(165px, 1fr)); gap: 12px; }
.tile { background: var(--card); border: 1px solid var(--rule); border-radius: 10px;
  padding: 12px 14px; }
.tile b { display: block; font-size: 24px; line-height: 1.25; font-variant-numeric: tabular-nums; }
.tile b small { font-size: 14px; font-weight: 500; color: var(--muted); }
.tile > span { font-size: 13px; color: var(--muted); }
.table { overflow-x: auto; margin: 10px 0 6px; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th, td { padding: 6px 10px; text-align: right; white-space: nowrap;
  border-bottom: 1px solid var(--rule); }
th { font-size: 12.5px; font-weight: 600; color: var(--muted); vertical-align: bottom; }
th:first-child, td:first-child { text-align: left; }
tr.mean td { font-weight: 600; border-bottom: none; }
td.main { font-weight: 700; }
.better { color: var(--good); font-weight: 600; }
.worse { color: var(--bad); font-weight: 600; }
.bars { display: inline-grid; width: 150px; gap: 2px; vertical-align: middle; }
.bars i { display: block; height: 6px; border-radius: 3px; min-width: 2px; }
.dot { display: inline-block; width: 10px; height: 10px; border-radius: 5px; margin-right: 8px; }
h3 .dot { margin: 0; }
.early { display: block; font-size: 12.5px; color: var(--bad); white-space: normal; }
.notes { border-left: 3px solid var(--bad); background: var(--card); margin: 18px 0 0;
  padding: 8px 12px 8px 30px; font-size: 13.5px; overflow-wrap: anywhere; }
.charts { display: grid; gap: 12px; }
.charts.four { grid-template-columns: repeat(4, minmax(0, 1fr)); }
.charts.three { grid-template-columns: repeat(3, minmax(0, 1fr)); }
.charts.paths { display: block; columns: 2; column-gap: 12px; }
.charts.paths figure { break-inside: avoid; margin-bottom: 12px; }
@media (max-width: 900px) {
  .charts.four { grid-template-columns: repeat(2, minmax(0, 1fr)); }
  .charts.three { grid-template-columns: minmax(0, 1fr); }
  .charts.paths { columns: 1; }
}
figure { margin: 0; background: var(--card); border: 1px solid var(--rule); border-radius: 10px;
  padding: 8px 8px 4px; }
svg.chart, figure img { display: block; width: 100%; height: auto; }
figure.wide { margin-top: 12px; padding: 8px; }
.chart text { fill: var(--muted); font-size: 10.5px; font-variant-numeric: tabular-nums; }
.chart .title { fill: var(--ink); font-size: 12px; font-weight: 600; }
.chart .middle { text-anchor: middle; }
.chart .end { text-anchor: end; }
.chart .grid line { stroke: var(--grid); stroke-width: 1; }
.chart .back { fill: var(--plot); }
.chart .frame { fill: none; stroke: var(--rule); }
.chart .curve { fill: none; stroke-linejoin: round; stroke-linecap: round; }
.chart .dashed { stroke-dasharray: 5 4; stroke-linecap: butt; }
.chart .marker { stroke: var(--plot); stroke-width: 1.5; }
.legend { display: flex; flex-wrap: wrap; gap: 3px 16px; margin: 8px 0 10px; font-size: 13px; }
.legend b { font-weight: 600; color: var(--muted); }
.legend span { display: inline-flex; align-items: center; gap: 6px; }
.legend i { display: inline-block; width: 20px; height: 0; border-top: 3px solid; }
.legend i.dashed { border-top: 2px dashed; }
.legend i.area { height: 10px; border: none; border-radius: 2px; }
.legend i.dotted { width: 9px; height: 9px; border: none; border-radius: 5px; }
footer { margin-top: 48px; font-size: 13px; color: var(--muted); }
@media (max-width: 560px) { .charts.four { grid-template-columns: minmax(0, 1fr); } }
@media print { figure, .tile { break-inside: avoid; } }
)css";

}  // namespace covey
