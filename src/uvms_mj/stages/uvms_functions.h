/* 53 random bits of a key and a counter, as uvms_mj.physics.random gives them (Philox-4x32-10). */
static inline uint64_t uvms_random_bits(uint64_t key, uint64_t instant, uint32_t index, uint32_t block)
{
    uint32_t c0 = (uint32_t)instant, c1 = (uint32_t)(instant >> 32), c2 = index, c3 = block;
    uint32_t k0 = (uint32_t)key, k1 = (uint32_t)(key >> 32);
    for (int i = 0; i < 10; i++) {
        uint64_t p0 = (uint64_t)c0 * 0xD2511F53u, p1 = (uint64_t)c2 * 0xCD9E8D57u;
        c0 = (uint32_t)(p1 >> 32) ^ c1 ^ k0;
        c1 = (uint32_t)p1;
        c2 = (uint32_t)(p0 >> 32) ^ c3 ^ k1;
        c3 = (uint32_t)p0;
        k0 += 0x9E3779B9u;
        k1 += 0xBB67AE85u;
    }
    return ((uint64_t)c0 << 21) + (c1 >> 11);
}

/* A normal random number, decided by key and instant of the stage and by its index in this instant: 0, 1, 2, ... */
static inline double uvms_standard_normal(int64_t key, int64_t instant, uint32_t index)
{
    double x = (double)(uvms_random_bits((uint64_t)key, (uint64_t)instant, index, 0) + 1) * 0x1p-53;
    double y = (double)uvms_random_bits((uint64_t)key, (uint64_t)instant, index, 1) * 0x1p-53;
    return sqrt(-2.0 * log(x)) * cos(6.283185307179586 * y);
}

/* The rotation matrix R (3, 3) of a unit quaternion w x y z. */
static inline void uvms_rotation(const double q[4], double R[3][3])
{
    double w = q[0], x = q[1], y = q[2], z = q[3];
    R[0][0] = 1 - 2 * (y * y + z * z), R[0][1] = 2 * (x * y - w * z), R[0][2] = 2 * (x * z + w * y);
    R[1][0] = 2 * (x * y + w * z), R[1][1] = 1 - 2 * (x * x + z * z), R[1][2] = 2 * (y * z - w * x);
    R[2][0] = 2 * (x * z - w * y), R[2][1] = 2 * (y * z + w * x), R[2][2] = 1 - 2 * (x * x + y * y);
}
