//! Definitions of the numbers on the page.

/// What the run does otherwise than the paper.
pub const DIFFERENCES: &str = "<h2 id=\"differs\">What differs from the paper</h2>
<ul>
<li>A contact is measured in simulated physics. The paper counts a collision when the held object, as felt, intersects the next one in
its planned place; the column <em>predicted risk</em> is that statistic.</li>
<li>Blind trials also fail because the first object is not picked up or lost; the paper&#39;s fail by collisions alone.</li>
<li>Touch may touch objects before it takes them, try again and decline; each costs time and may cost a contact, which counts.</li>
<li>The reflex condition, the mixed model and the effect sizes are not in the paper.</li>
<li>The errors of arm and vision were set so that blind success comes near the paper&#39;s; the paper does not give theirs.</li>
</ul>
";

/// Terms and their meaning; no data in it.
pub const SECTION: &str = "<h2 id=\"terms\">What the numbers mean</h2>
<dl class=\"terms\">
<dt>Trial</dt>
<dd>Pick up the first object, look at it with the touch sensors, pick up the second object beside it, carry both, hold both.
Trials of one combination differ in the drawn execution and perception errors; trials of the same number meet the same
errors under every condition.</dd>
<dt>Ideal, blind, reflex, touch, own</dt>
<dd><em>Ideal</em> is the plan carried out without any error; as nothing varies then, one trial of each combination is
enough. <em>Blind</em> carries out the same plan with errors, whatever
the sensors say. <em>Touch</em> meets the same errors. It touches each object before it takes it, to find out where it is, estimates
from the tactile images how the first object really sits in the hand, and takes the second one with the grasp and the aim that
promise most. After each lift and after the hold it feels
whether both objects are there, and tries again what failed, as long as the time allows. Where a contact is likelier than a hold
it puts the first object down and takes it otherwise, or leaves the second one alone (<em>declined</em>). <em>Reflex</em> does the
same with the servos&#39; encoders and currents alone, without any tactile image. <em>Own</em>, where there is one, is a policy of whoever
ran the benchmark, with the same errors.</dd>
<dt>Contact</dt>
<dd>Judged by the referee from the simulator&#39;s ground truth (on hardware by the operator), never by the controller: before the
second grasp has closed, the held first object, a digit holding it, or the palm touches the second object; or the second object
is knocked away before its grasp begins without a free digit having touched it. All tries of a trial count. A contact does not
end a trial, and a trial with a contact can succeed.</dd>
<dt>Success, clean success</dt>
<dd>At the end of the hold, which lasted its full time and ended within the time limit, both objects are in the hand (touched by
it, off the table, near the palm), and neither has moved relative to the palm by more than the allowed slip since the carry began.
Clean success is success without any unwanted contact.</dd>
<dt>Rates</dt>
<dd>Share of a combination&#39;s trials. Mean and standard deviation are over combinations (sample standard deviation, n&minus;1), as
in the paper; one combination is one independent replicate.</dd>
<dt>Predicted risk</dt>
<dd>Probability that the planned second grasp ends in an unwanted contact, as predicted from what was felt of the first object at
the first decision. For a blind trial it is predicted in the same way from its own hold, and changes nothing.</dd>
<dt>Test</dt>
<dd>Paired one-sided t-test over combinations: is the contact rate higher blind than ideal, are success and clean
success more frequent with touch than blind, and than reflex? No adjustment for multiple comparisons, as in the paper.</dd>
<dt>Difference size, power, McNemar</dt>
<dd>d_z is the mean of the paired differences over their standard deviation; intervals are percentiles over 10,000 resamples of
the combinations. Power is the share of 2,000 resamples of so many combinations in which the t-test stays below 0.05. McNemar&#39;s
test looks only at trials of the same errors that ended differently.</dd>
<dt>Mixed model</dt>
<dd>The difference of a pair of trials is a mean, plus what its combination adds, plus what the trial adds. Variances are those of
the one-way analysis of variance, the mean is weighted with them. It needs combinations of at least two trials.</dd>
<dt>Switched</dt>
<dd>Share of touch trials in which the controller left the plan: another second grasp, or a new try.</dd>
<dt>Decision time</dt>
<dd>Wall time from the last tactile image of the look to the decision: pose estimate, collision check, choice of strategy.</dd>
<dt>Pose error</dt>
<dd>Distance and angle between the pose of the held object as estimated by touch and as the simulator has it; turns that leave
the object looking the same do not count.</dd>
<dt>Real-time factor</dt>
<dd>Seconds of trial simulated per second of wall time.</dd>
</dl>
<p>The paper judges a collision differently: it estimates the pose of the held object by touch and asks whether its geometry
would overlap the next object&#39;s; a trial predicted to collide counts as failed without touch. In its figures success without
touch is therefore one minus the collision rate: what is called clean success here. Here all are observed in physics.</p>
";
