"""The report's page: markup and style, light and dark."""

from string import Template

PAGE = Template("""<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>$title</title>
<style>
:root { color-scheme: light dark; --paper: #fcfcfa; --card: #ffffff; --ink: #1f1f1c; --soft: #6b6b64; --rule: #deded8;
  --good: #1a7f45; --care: #a15c00; --bad: #c0262d; --mark: #3e63dd }
@media (prefers-color-scheme: dark) { :root { --paper: #161614; --card: #1f1f1c; --ink: #ececE6; --soft: #a3a39b; --rule: #3a3a35;
  --good: #4cc38a; --care: #f1a10d; --bad: #ff6369; --mark: #849dff } }
* { box-sizing: border-box }
body { margin: 0; background: var(--paper); color: var(--ink); font: 15px/1.5 system-ui, sans-serif }
main { max-width: 1180px; margin: 0 auto; padding: 24px 20px 60px }
h1 { font-size: 22px; margin: 0 } h2 { font-size: 17px; margin: 0 0 12px } h3 { font-size: 14px; margin: 0 0 6px }
p { margin: 8px 0 } .made, figcaption { color: var(--soft); font-size: 13px }
.verdict { border-left: 6px solid var(--tone); background: var(--card); padding: 14px 18px; margin: 18px 0; border-radius: 4px }
.verdict strong { font-size: 20px; color: var(--tone) }
.good { --tone: var(--good) } .care { --tone: var(--care) } .bad { --tone: var(--bad) }
section { background: var(--card); border: 1px solid var(--rule); border-radius: 6px; padding: 16px 18px; margin: 16px 0 }
figure { margin: 0 0 10px } img { max-width: 100%; max-height: 620px; display: block; border-radius: 3px }
.pair { display: grid; grid-template-columns: repeat(auto-fit, minmax(min(100%, 440px), 1fr)); gap: 18px; align-items: start }
.scroll { overflow-x: auto } table { border-collapse: collapse; font-variant-numeric: tabular-nums; margin: 6px 0 }
td, th { text-align: left; padding: 3px 14px 3px 0; border-bottom: 1px solid var(--rule); vertical-align: top }
th { color: var(--soft); font-weight: 500 }
ul { margin: 8px 0; padding-left: 20px }
svg { width: 100%; height: auto; display: block }
svg .grid { stroke: var(--rule); stroke-width: 1 } svg text { fill: var(--soft); font: 12px system-ui, sans-serif }
svg polyline { fill: none; stroke-width: 1.6; stroke: #b658c4 } svg .ideal { stroke: var(--mark); stroke-dasharray: 5 4 }
svg .plane-R { stroke: #e5484d } svg .plane-G { stroke: #30a46c } svg .plane-B { stroke: #3e63dd } svg .plane-W { stroke: #8d8d86 }
.patches { display: grid; grid-template-columns: repeat(6, 1fr); gap: 8px; margin: 10px 0 }
.patch b { display: flex; height: 62px; border-radius: 3px; overflow: hidden } .patch i { flex: 1 }
.patch span { display: block; font-size: 12px; color: var(--soft); line-height: 1.3 }
.light { display: grid; gap: 2px; max-width: 420px; font-size: 12px }
.light div { padding: 8px 0; text-align: center; color: #1f1f1c; border-radius: 2px }
pre { overflow: auto; max-height: 480px; font-size: 12px }
@media (max-width: 640px) { .patches { grid-template-columns: repeat(3, 1fr) } }
@media print { section { break-inside: avoid } }
</style>
</head>
<body><main>
<h1>$title</h1>
<div class="made">$made</div>
<div class="verdict $kind"><strong>$verdict</strong>$why</div>
$sections
</main></body></html>
""")
