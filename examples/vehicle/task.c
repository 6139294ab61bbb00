/* A task of fixed rate that runs an exported law: what a timer calls in every period.

   Here a terminal stands for the vehicle. Each line that is read is what the sensors say in a
   period, the pose row by row and the velocity; each line that is written is the torque for the
   actuators. At the end, the processor's time for a call is written to stderr. */
#include <stdio.h>
#include <time.h>

#include "goodarzi2013.h"

enum { POSE = 9, VELOCITY = 3, TORQUES = 3 };

static goodarzi2013_memory memory;
static goodarzi2013_input input;

/* Once in every period; `count` is the number of periods since the start. */
static void task(long count, float torque[TORQUES])
{
    goodarzi2013_reference((double)count * GOODARZI2013_PERIOD, &input);
    if (count == 0)
        goodarzi2013_start(&goodarzi2013_defaults, &memory, &input);
    goodarzi2013_torque(&goodarzi2013_defaults, &memory, &input, torque);
}

static int sensed(float *numbers, int length)
{
    int k;
    for (k = 0; k < length; k++)
        if (scanf("%f", &numbers[k]) != 1)
            return 0;
    return 1;
}

int main(void)
{
    float torque[TORQUES];
    clock_t busy = 0;
    long count;
    for (count = 0; sensed(input.pose, POSE) && sensed(input.velocity, VELOCITY); count++) {
        const clock_t before = clock();
        task(count, torque);
        busy += clock() - before;
        printf("%.9g %.9g %.9g\n", (double)torque[0], (double)torque[1], (double)torque[2]);
    }
    if (count)
        fprintf(stderr, "%ld calls, %.2f us each\n", count,
                1e6 * (double)busy / CLOCKS_PER_SEC / (double)count);
    return 0;
}
