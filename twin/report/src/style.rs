//! The look of the page and of its figures: one palette, light and dark, for both.

/// The palette, and what the shapes of a figure look like. Goes into the page once and into every figure that stands alone.
pub const FIGURE: &str = "
:root{--paper:#ffffff;--ink:#1d2429;--soft:#56626b;--line:#cfd6db;--tint:#f3f6f8;
--ideal:#6b7780;--blind:#b8500c;--reflex:#2b6cb0;--touch:#0b7a4b;--yours:#7b3fa0;color-scheme:light dark}
@media (prefers-color-scheme:dark){:root{--paper:#14191d;--ink:#e6ebee;--soft:#a4b0b8;--line:#3a454d;--tint:#1d2429;
--ideal:#a9b4bc;--blind:#f2985a;--reflex:#7fb2e6;--touch:#52c795;--yours:#c79be6}}
.figure{font-family:system-ui,'Helvetica Neue',Arial,sans-serif;font-size:13px}
.figure text{fill:var(--ink)}
.figure .paper{fill:var(--paper)}
.figure .title{font-size:15px;font-weight:600}
.figure .soft{fill:var(--soft);font-size:12px}
.figure .grid{stroke:var(--line);stroke-width:1}
.figure .axis,.figure .bracket{stroke:var(--soft);stroke-width:1;fill:none}
.figure .ideal{--own:var(--ideal)}.figure .blind{--own:var(--blind)}.figure .reflex{--own:var(--reflex)}.figure .touch{--own:var(--touch)}.figure .own{--own:var(--yours)}
.figure .shade{fill:var(--own);fill-opacity:.28;stroke:var(--own);stroke-width:1}
.figure .box{fill:var(--paper);stroke:var(--own);stroke-width:1.6}
.figure .whisker{stroke:var(--own);stroke-width:1.6;fill:none}
.figure .median{stroke:var(--own);stroke-width:4}
.figure .mean{fill:var(--paper);stroke:var(--own);stroke-width:1.6}
.figure .curve{fill:none;stroke:var(--own);stroke-width:2}
.figure .dot{fill:var(--own);fill-opacity:.85}
";

/// What only the page needs.
pub const PAGE: &str = "
*{box-sizing:border-box}
body{margin:0;background:var(--paper);color:var(--ink);font:16px/1.55 system-ui,'Helvetica Neue',Arial,sans-serif}
main{max-width:1120px;margin:0 auto;padding:28px 24px 64px}
h1{font-size:1.75rem;line-height:1.2;margin:0 0 4px}
h2{font-size:1.2rem;margin:40px 0 8px;border-bottom:1px solid var(--line);padding-bottom:4px}
p,dd,li{max-width:78ch}
.byline{color:var(--soft);margin:0 0 20px}
.verdict{background:var(--tint);border-left:5px solid var(--touch);padding:14px 18px;margin:0;max-width:none;font-size:1.06rem}
.verdict.short{border-color:var(--blind)}
.warnings{background:#b3121d;color:#fff;border-radius:6px;padding:12px 18px 12px 34px;margin:0 0 16px;max-width:none;font-weight:600}
.warnings li{max-width:none}
.maps{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,420px),1fr));gap:20px}.maps text{font-size:10px}
.objects{display:flex;flex-wrap:wrap;gap:6px}.objects figure{width:96px;text-align:center}.objects figcaption{margin:0;font-size:.78rem;line-height:1.2}
.objects img{border-radius:6px}.strip img{width:100%;height:auto;border-radius:6px}
thead th{cursor:pointer}
.scroll{overflow-x:auto;margin:14px 0}
table{border-collapse:collapse;font-size:.94rem;min-width:50%}
caption{text-align:left;color:var(--soft);padding:0 0 6px;font-size:.9rem}
th,td{text-align:left;padding:5px 14px 5px 6px;border-bottom:1px solid var(--line);vertical-align:top}
th{font-weight:600}tbody th{font-weight:500}
.number{text-align:right;font-variant-numeric:tabular-nums;white-space:nowrap}
thead th{border-bottom:2px solid var(--soft);vertical-align:bottom}thead th.number{white-space:normal}
a{color:inherit}
details{margin:10px 0}summary{cursor:pointer}
tbody tr:hover{background:var(--tint)}
.figures{display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,460px),1fr));gap:20px}
figure{margin:0}figure svg{width:100%;height:auto;display:block}
figcaption{color:var(--soft);font-size:.9rem;margin-top:6px}
.facts{display:grid;grid-template-columns:repeat(auto-fit,minmax(210px,1fr));gap:12px;margin:14px 0;padding:0}
.facts div{background:var(--tint);padding:10px 14px;border-radius:6px}
.facts dt{color:var(--soft);font-size:.88rem}.facts dd{margin:0;font-size:1.1rem;font-variant-numeric:tabular-nums}
.terms dt{font-weight:600;margin-top:10px}.terms dd{margin:0}
pre{background:var(--tint);padding:12px 14px;overflow-x:auto;font-size:.9rem;border-radius:6px}
code{font-family:ui-monospace,Menlo,Consolas,monospace}
@media(max-width:700px){main{padding:20px 14px 48px}table{font-size:.86rem}td:last-child:not(.number){min-width:22em}}
@media print{.warnings{-webkit-print-color-adjust:exact;print-color-adjust:exact}main{max-width:none;padding:0}tbody tr{break-inside:avoid}figure{break-inside:avoid}}
";
