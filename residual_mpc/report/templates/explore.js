/* The sliders: replays of a few windows with other values of one parameter at a time. */
(function () {
  "use strict";
  var data = JSON.parse(document.getElementById("explore-data").textContent), box = document.getElementById("explorer");
  var pick = document.getElementById("explore-view"), says = document.getElementById("explore-says");
  var inputs = Array.prototype.slice.call(box.querySelectorAll("input[type=range]")), view = 0, slider = 0, looks = [];
  var plots = linkedPlots(document.getElementById("explore-panels"), [MEASURED, NOMINAL, corrected("slider")]);

  function follow() {
    var s = data.sliders[slider], i = Number(inputs[slider].value);
    looks.forEach(function (look) { look.values[2] = look.curves[slider][i]; look.frame = look.curves[slider]; });
    plots.draw();
    says.textContent = s.name + " " + s.labels[i] + (i === s.fitted ? " (fitted)" : s.inside[i] ? " (inside the 95 % interval)" : " (outside the 95 % interval)") +
      ": gap " + data.views[view].gaps[slider][i] + " in this window, " + s.gaps[i] + " over the held-out windows.";
  }
  function show(index) {
    view = index;
    looks = data.views[view].looks.map(function (l) {
      return { channel: l.channel, unit: l.unit, t: l.t, values: [l.measured, l.before, null], curves: l.curves };
    });
    plots.show(looks, data.views[view].name); follow();
  }
  function set(k, value) {
    inputs[k].value = value;
    inputs[k].nextElementSibling.textContent = data.sliders[k].labels[Number(value)];
    inputs[k].setAttribute("aria-valuetext", data.sliders[k].labels[Number(value)]);
  }
  data.views.forEach(function (v, k) { var o = document.createElement("option"); o.value = k; o.textContent = v.name; pick.appendChild(o); });
  pick.addEventListener("change", function () { show(Number(pick.value)); });
  inputs.forEach(function (input, k) {
    set(k, data.sliders[k].fitted);
    input.addEventListener("input", function () {
      inputs.forEach(function (other, i) { set(i, i === k ? input.value : data.sliders[i].fitted); });
      slider = k; follow();
    });
  });
  plots.buttons(box);
  box.hidden = false;
  show(0);
})();
