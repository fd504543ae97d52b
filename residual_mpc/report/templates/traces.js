/* The traces of every run: measured and predicted, with a picker for the run and for the window. */
(function () {
  "use strict";
  var data = JSON.parse(document.getElementById("traces-data").textContent), box = document.getElementById("tracer");
  var runs = document.getElementById("traces-run"), pick = document.getElementById("traces-window");
  var strip = document.getElementById("traces-strip"), NS = "http" + "://www.w3.org/2000/svg", run = null, marker = null;
  var series = [MEASURED, NOMINAL].concat(data.explained ? [corrected("corrected")] : []);
  var plots = linkedPlots(document.getElementById("traces-panels"), series);

  function bytes(text) { var s = atob(text), out = new Uint8Array(s.length); for (var k = 0; k < s.length; k++) out[k] = s.charCodeAt(k); return out.buffer; }
  function values(text, low, high) {  // 16 bits between the channel's ends, the lowest number for a missing sample
    return text && Array.prototype.map.call(new Int16Array(bytes(text)), function (v) { return v === -32768 ? null : low + (v + 32767) / 65534 * (high - low); });
  }
  function option(parent, value, text) { var o = document.createElement("option"); o.value = value; o.textContent = text; parent.appendChild(o); }
  function span(k) { return [run.t[run.first[k]], run.t[(k + 1 < run.first.length ? run.first[k + 1] : run.t.length) - 1]]; }
  function bar(kind, k, height) {
    var e = document.createElementNS(NS, "rect"), s = span(k), all = run.t[run.t.length - 1] - run.t[0] || 1;
    e.setAttribute("class", kind); e.setAttribute("x", 1000 * (s[0] - run.t[0]) / all); e.setAttribute("width", Math.max(1, 940 * (s[1] - s[0]) / all));
    e.setAttribute("y", 40 - height); e.setAttribute("height", height); strip.appendChild(e);
  }
  function overview() {  // a bar a window: its gap before, and after
    strip.textContent = "";
    var most = Math.max.apply(null, run.gaps.map(function (g) { return g[0]; })) || 1;
    run.gaps.forEach(function (g, k) { bar("piece", k, Math.max(1, 38 * g[0] / most)); if (g[1] !== null) bar("piece-after", k, Math.max(1, 38 * Math.min(g[1] / most, 1))); });
    marker = document.createElementNS(NS, "rect"); marker.setAttribute("class", "mark"); marker.setAttribute("y", 1); marker.setAttribute("height", 38);
    strip.appendChild(marker);
  }
  function go(k) {
    if (k < 0) plots.zoom(run.t[0], run.t[run.t.length - 1]); else { var s = span(k); plots.zoom(s[0], s[1]); }
  }
  plots.zoomed = function (from, to) {
    var shown = from <= run.t[0] && to >= run.t[run.t.length - 1] ? "-1" : "";
    run.first.forEach(function (f, k) { var s = span(k); if (s[0] === from && s[1] === to) shown = String(k); });
    pick.value = shown;
    var all = run.t[run.t.length - 1] - run.t[0] || 1;
    marker.setAttribute("x", 1000 * (from - run.t[0]) / all); marker.setAttribute("width", Math.max(2, 1000 * (to - from) / all));
  };
  function show(index) {
    var r = data.runs[index];
    run = { t: Array.prototype.slice.call(new Float32Array(bytes(r.t))), first: r.first, gaps: r.gaps };
    pick.textContent = ""; option(pick, "", "as zoomed"); pick.options[0].disabled = true; option(pick, -1, "whole run");
    r.labels.forEach(function (text, k) { option(pick, k, text); });
    overview();
    plots.show(r.channels.map(function (c) {
      return { channel: c.channel, unit: c.unit, t: run.t, starts: run.first, values: c.values.map(function (v) { return values(v, c.low, c.high); }) };
    }), r.name);
    go(r.opens);
  }
  data.runs.forEach(function (r, k) { option(runs, k, r.label); });
  runs.addEventListener("change", function () { show(Number(runs.value)); });
  pick.addEventListener("change", function () { go(Number(pick.value)); });
  strip.addEventListener("click", function (e) {
    var r = strip.getBoundingClientRect(), at = run.t[0] + (e.clientX - r.left) / r.width * (run.t[run.t.length - 1] - run.t[0]), k = 0;
    while (k + 1 < run.first.length && run.t[run.first[k + 1]] <= at) k++;
    go(k);
  });
  plots.buttons(box);
  box.hidden = false;
  document.getElementById("traces-still").className += " replaced";
  show(0);
})();
