# SPDX-FileCopyrightText: The kitti_ros2 authors
# SPDX-License-Identifier: Apache-2.0
"""The style sheet of the page: one column of cards, light or dark by the system's setting.

Text has a contrast of at least 4.5 to 1 with its background, in both (WCAG 2.1, AA).
"""

STYLE = """
:root {
  color-scheme: light dark;
  --ground: #f4f5f8; --card: #ffffff; --inset: #f4f5f8; --line: #dde1e8; --grid: #e8ebf0;
  --text: #1b2130; --muted: #586174; --accent: #0a63c2; --soft: #cfe2f8;
  --loss: #b3261e; --warning: #8a5200; --note: #4a5568; --well: #1d7440;
  --x: #c02b20; --y: #23793b; --z: #1d5fd0;
  --share0: #0a63c2; --share1: #5a9ae0; --share2: #a5caf1; --share3: #c3c8d2;
}
@media (prefers-color-scheme: dark) {
  :root {
    --ground: #0e1117; --card: #171b24; --inset: #0f131a; --line: #2b3240; --grid: #242a36;
    --text: #e7eaf0; --muted: #a0a9b9; --accent: #74b5ff; --soft: #1f3a5c;
    --loss: #ff8f85; --warning: #f2b654; --note: #b3bccb; --well: #6fcf8f;
    --x: #ff8378; --y: #6fce86; --z: #7fb0ff;
    --share0: #74b5ff; --share1: #4583c4; --share2: #2c5586; --share3: #4a5262;
  }
}
* { box-sizing: border-box; }
html { -webkit-text-size-adjust: 100%; scroll-behavior: smooth; }
@media (prefers-reduced-motion: reduce) { html { scroll-behavior: auto; } }
body {
  margin: 0; background: var(--ground); color: var(--text);
  font: 16px/1.55 system-ui, -apple-system, "Segoe UI", Roboto, "Noto Sans", sans-serif;
}
.column { max-width: 1120px; margin: 0 auto; padding: 0 20px; }
a { color: var(--accent); }
:focus-visible { outline: 3px solid var(--accent); outline-offset: 2px; border-radius: 4px; }
.skip { position: absolute; left: -999px; top: 8px; padding: 8px 14px; background: var(--card);
  border-radius: 8px; z-index: 2; }
.skip:focus { left: 8px; }
header { padding: 44px 0 8px; }
.eyebrow { margin: 0; color: var(--muted); font-size: 14px; letter-spacing: .02em; }
h1 { margin: 4px 0 8px; font-size: clamp(24px, 4.4vw, 36px); line-height: 1.15; font-weight: 650;
  letter-spacing: -.015em; overflow-wrap: anywhere; }
.summary { margin: 0; max-width: 68ch; color: var(--muted); overflow-wrap: anywhere; }
dl.figures { display: grid; grid-template-columns: repeat(auto-fit, minmax(128px, 1fr)); gap: 12px;
  margin: 24px 0 0; }
dl.figures div { display: flex; flex-direction: column-reverse; background: var(--card);
  border: 1px solid var(--line); border-radius: 12px; padding: 12px 16px; }
dl.figures dt { color: var(--muted); font-size: 13px; }
dl.figures dd { margin: 0; font-size: 22px; font-weight: 620; letter-spacing: -.01em;
  font-variant-numeric: tabular-nums; white-space: nowrap; }
nav ul { list-style: none; display: flex; flex-wrap: wrap; gap: 6px 18px; margin: 22px 0 0;
  padding: 0; font-size: 15px; }
nav a { display: inline-block; padding: 4px 0; text-decoration: none; }
nav a:hover { text-decoration: underline; }
section { background: var(--card); border: 1px solid var(--line); border-radius: 16px;
  padding: 26px 28px; margin: 20px 0; scroll-margin-top: 12px; }
h2 { margin: 0 0 4px; font-size: 21px; font-weight: 640; letter-spacing: -.01em; }
h3 { margin: 30px 0 6px; font-size: 16px; font-weight: 640; }
p { margin: 6px 0 0; max-width: 76ch; }
.lead { color: var(--muted); }
.findings { list-style: none; margin: 16px 0 0; padding: 0; }
.findings li { display: grid; grid-template-columns: 22px 1fr; gap: 2px 12px; padding: 12px 0;
  border-top: 1px solid var(--line); overflow-wrap: anywhere; }
.findings li:first-child { border-top: 0; padding-top: 4px; }
.findings .icon { width: 22px; height: 22px; margin-top: 1px; }
.findings strong { font-weight: 640; }
.loss { --tone: var(--loss); } .warning { --tone: var(--warning); } .note { --tone: var(--note); }
.well { --tone: var(--well); }
.findings strong, .icon { color: var(--tone); }
.where { font-weight: 560; }
details { margin-top: 14px; }
summary { cursor: pointer; color: var(--accent); padding: 4px 0; }
.scroll { overflow-x: auto; margin-top: 16px; border-radius: 8px; }
table { border-collapse: collapse; width: 100%; font-size: 14.5px; }
caption { text-align: left; color: var(--muted); font-size: 14px; padding: 0 0 8px; }
caption span { display: inline-block; position: sticky; left: 0; max-width: calc(100vw - 64px); }
th, td { padding: 8px 10px; border-top: 1px solid var(--line); text-align: left;
  vertical-align: top; white-space: nowrap; }
thead th { border-top: 0; color: var(--muted); font-weight: 560; font-size: 13px;
  vertical-align: bottom; }
thead .num { white-space: normal; }
tbody th { font-weight: 560; }
.name { min-width: 20ch; }
tfoot th, tfoot td { font-weight: 640; }
th:first-child, td:first-child { padding-left: 0; position: sticky; left: 0;
  background: var(--card); }
th:last-child, td:last-child { padding-right: 0; }
.num { text-align: right; font-variant-numeric: tabular-nums; }
.faint { color: var(--muted); }
.wide { white-space: normal; min-width: 20ch; }
.grid { display: grid; grid-template-columns: repeat(auto-fill, minmax(min(100%, 310px), 1fr));
  gap: 24px 28px; margin-top: 16px; }
.pair { grid-template-columns: repeat(auto-fill, minmax(min(100%, 420px), 1fr)); }
figure { margin: 0; min-width: 0; }
figcaption { color: var(--muted); font-size: 14px; margin-top: 6px; overflow-wrap: anywhere; }
figcaption b { color: var(--text); font-weight: 600; }
figure img { display: block; width: 100%; height: auto; border-radius: 8px;
  background: var(--inset); }
.single { max-width: 500px; margin-top: 16px; }
svg.plot { display: block; width: 100%; height: auto; max-width: 620px; background: var(--inset);
  border-radius: 10px; }
svg text { font: 12px system-ui, -apple-system, "Segoe UI", Roboto, "Noto Sans", sans-serif;
  fill: var(--muted); font-variant-numeric: tabular-nums;
  paint-order: stroke; stroke: var(--inset); stroke-width: 3px; stroke-linejoin: round; }
svg .unit { font-size: 11.5px; } svg .label, svg .distance { fill: var(--text); font-weight: 600; }
.grid-line { stroke: var(--grid); stroke-width: 1; } .axis { stroke: var(--muted); }
.median { stroke: var(--muted); stroke-dasharray: 4 4; }
.gap-line { stroke: var(--loss); stroke-width: 1; stroke-dasharray: 2 3; }
.bar { fill: var(--accent); } .gap { fill: var(--loss); }
.dots { stroke: var(--accent); stroke-width: 3.4; stroke-linecap: round; fill: none; }
.ranges { stroke: var(--accent); stroke-width: 1.4; stroke-linecap: round; fill: none; }
.route { fill: none; stroke: var(--accent); stroke-width: 2.6; stroke-linejoin: round;
  stroke-linecap: round; }
.start { fill: var(--card); stroke: var(--text); stroke-width: 2.2; } .end { fill: var(--text); }
.scale { fill: none; stroke: var(--text); stroke-width: 1.6; }
.link { stroke: var(--muted); stroke-width: 1.2; stroke-dasharray: 3 3; }
path.axis-x { stroke: var(--x); } path.axis-y { stroke: var(--y); }
path.axis-z { stroke: var(--z); }
path[class^=axis] { stroke-width: 2.4; stroke-linecap: round; fill: none; }
text.axis-x { fill: var(--x); } text.axis-y { fill: var(--y); } text.axis-z { fill: var(--z); }
svg text[class^=axis] { font-weight: 600; }
circle.badge { fill: var(--text); stroke: var(--inset); stroke-width: 1.5; }
svg text.badge { fill: var(--card); stroke: none; font-size: 10.5px; font-weight: 650; }
.number { display: inline-block; min-width: 20px; margin-right: 8px; padding: 0 5px;
  border-radius: 10px; background: var(--text); color: var(--card); font-size: 12px;
  font-weight: 650; line-height: 20px; text-align: center; }
.coverage { list-style: none; margin: 14px 0 0; padding: 0; }
.coverage li { display: grid; grid-template-columns: minmax(0, 300px) 1fr; gap: 4px 18px;
  align-items: center; padding: 5px 0; font-size: 14.5px; overflow-wrap: anywhere; }
.strip { width: 100%; height: 14px; background: var(--inset); border-radius: 4px; }
.shares { width: 90px; height: 12px; border-radius: 3px; vertical-align: -1px; }
.share0 { fill: var(--share0); } .share1 { fill: var(--share1); } .share2 { fill: var(--share2); }
.share3 { fill: var(--share3); }
article { border-top: 1px solid var(--line); margin-top: 24px; padding-top: 18px; }
article h3 { margin-top: 0; }
.shots { display: grid; gap: 12px 16px; margin-top: 12px; align-items: start;
  grid-template: "camera above" "points above" / minmax(0, 2.6fr) minmax(0, 1fr); }
.shots:not(:has(.above)) { grid-template: "camera" "points" / minmax(0, 820px); }
.shots:not(:has(.camera, .points)) { grid-template: "above" / minmax(0, 420px); }
.camera { grid-area: camera; } .points { grid-area: points; } .above { grid-area: above; }
.swatch { width: 12px; height: 12px; margin-right: 8px; vertical-align: -1px; }
footer { color: var(--muted); font-size: 14px; padding: 8px 0 48px; overflow-wrap: anywhere; }
@media (max-width: 640px) {
  .column { padding: 0 14px; }
  header { padding-top: 26px; }
  section { padding: 20px 16px; border-radius: 14px; margin: 14px 0; }
  dl.figures { grid-template-columns: repeat(2, minmax(0, 1fr)); gap: 8px; }
  dl.figures div { padding: 10px 12px; } dl.figures dd { font-size: 19px; }
  .coverage li { grid-template-columns: minmax(0, 1fr); }
  th:first-child, td:first-child { white-space: normal; overflow-wrap: anywhere;
    min-width: 38vw; max-width: 46vw; }
}
@media (max-width: 640px) {
  .shots { grid-template: "camera" "points" "above" / minmax(0, 1fr); }
  .above { max-width: 250px; }
}
@media print {
  :root { color-scheme: light; --ground: #fff; }
  body { font-size: 11pt; } nav, .skip { display: none; }
  section { border: 0; padding: 0; margin: 18px 0; } figure, tr, li { break-inside: avoid; }
  .scroll { overflow: visible; } th, td { white-space: normal; }
}
"""
